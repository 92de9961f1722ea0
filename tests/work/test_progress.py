from vioapr.work.progress import Progress, Tick, ignore, silent


def test_silence_takes_all_that_progress_takes():
    progress: Progress = silent
    with progress("working", 3) as advance:
        advance()
        advance(2)
        tick: Tick = advance
        tick()
    ignore()
