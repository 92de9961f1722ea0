"""The project's own method: a robust consensus of past predictions, carried by VIO.

Every past prediction, carried on by VIO, is a vote for where the camera is now. A vote's error
is a bias that depends on the view, heavy-tailed, plus what VIO has drifted since. How large the
two are is found while running, so that VIO is trusted no more than it earns: with good odometry
the method averages over a minute, with bad odometry over the last few predictions.

- `tracker.py`: what the tracker has come by, and its jumps.
- `votes.py`: the memory, of a fixed number of votes that differ in view.
- `stated.py`: what the regressor states of its errors.
- `views.py`: votes of one view share one weight.
- `rotation.py`, `position.py`, `robust.py`: the votes' robust means, in which votes far from the
  others count little, and gravity is used where it is known.
- `drift.py`, `trust.py`: how fast VIO drifts, by the likelihood of the votes' differences.
- `anchor.py`, `estimate.py`: the latest mean, carried on by VIO, and its uncertainty.
- `method.py`: the step.
"""
