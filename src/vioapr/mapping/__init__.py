"""Structure from motion to a metric, gravity-aligned map, and ground truth in it."""
