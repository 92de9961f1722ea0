"""Structure from motion to a metric, gravity-aligned map, and ground truth in it.

Its face: `pipeline` and `params`; the other modules are its steps.
"""
