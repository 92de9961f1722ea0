"""A calibration with round numbers."""

import msgspec

from vioapr.schemas.calibration import (
    ChainSetting,
    Coverage,
    Disagreement,
    LeftOut,
    MadeFrom,
    PairCalibration,
    PredictionErrors,
    Ratios,
    TrackerDrift,
)

SETTING = ChainSetting("known", 1e-6, 2e-4, 0.01, 0.02, 0.5, 0.75)


def pair_of(tracker="arkit", regressor="posenet", **changes):
    pair = PairCalibration(
        tracker=tracker,
        regressor=regressor,
        made_from=MadeFrom(("Set/a", "Set/b"), 100.0, 90.0, 400),
        setting=SETTING,
        disagreement=Disagreement(0.5, 2.0, 1.5),
        drift=TrackerDrift(1e-6, 1e-5, 0.001, 1.01, 0.02, 0.3, True),
        errors=PredictionErrors((0.1, 0.2, 0.3), (0.01, 0.02, 0.03), 2.5, 3.5, 1.5, 4.0),
        left_out=LeftOut(
            2,
            Ratios(0.5, 0.4, 0.3, 0.2),
            Ratios(0.9, 0.8, 0.7, 0.6),
            Coverage(0.2, 0.5, 0.75),
            Coverage(0.1, 0.4, 0.6),
        ),
    )
    return msgspec.structs.replace(pair, **changes)
