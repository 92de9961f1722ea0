from vioapr.cli.training_lines import TrainingLines
from vioapr.regression.watch import StepsOfEpoch
from vioapr.schemas.regressor import EpochRecord


def test_lines_tell_loss_error_rate_and_time_left():
    lines, now_s = [], [0.0]
    watch = TrainingLines(10, lines.append, lambda: now_s[0])
    assert not watch.is_due()
    now_s[0] = 50.0
    assert watch.is_due()
    assert not watch.is_due()
    watch.tell_steps(StepsOfEpoch(epoch=1, step=5, steps=10, loss=0.123456, images_per_s=85.4))
    now_s[0] = 100.0
    watch.tell_epoch(1, 10, EpochRecord(0.1, 1e-4, 86.0))
    now_s[0] = 200.0
    watch.tell_epoch(2, 10, EpochRecord(0.05, 1e-4, 86.0, 0.5214, 3.1))
    assert lines == [
        "training: epoch 1 of 10, step 5 of 10: loss 0.1235, 85 images/s, ETA 15 min 50 s",
        "training: epoch 1 of 10, step 10 of 10: loss 0.1, 86 images/s, ETA 15 min 00 s",
        "training: epoch 2 of 10, step 10 of 10: loss 0.05, validation 0.521 m, 3.10 deg, "
        "86 images/s, ETA 13 min 20 s",
    ]


def test_time_left_counts_what_this_process_has_done():
    lines, now_s = [], [0.0]
    watch = TrainingLines(100, lines.append, lambda: now_s[0])
    now_s[0] = 10.0
    watch.tell_epoch(91, 4, EpochRecord(0.1, 1e-4, 86.0))  # resumed after 90
    assert lines[0].endswith("ETA 1 min 30 s")
