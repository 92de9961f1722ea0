"""Where a phone is in a real place: absolute poses made robust by visual-inertial odometry."""
