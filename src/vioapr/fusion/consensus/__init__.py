"""The project's own method: a robust consensus of past predictions, carried by VIO.

Every past prediction, carried on by VIO, is a vote for where the camera is now. A vote's error
is a bias that depends on the view, heavy-tailed, plus what VIO has drifted since. How large the
two are is found while running, so that VIO is trusted no more than it earns: with good odometry
the method averages over a minute, with bad odometry over the last few predictions.

- `votes.py`: the memory, of a fixed number of votes that differ in view.
- `fit.py`: the votes' robust means, in which votes of one view share one weight, votes far from
  the others count little, and gravity is used where it is known.
- `drift.py`: how fast VIO drifts, by the likelihood of the votes' differences.
- `method.py`: the step.
"""
