"""Fusion of absolute pose predictions with odometry: methods, streaming and offline."""
