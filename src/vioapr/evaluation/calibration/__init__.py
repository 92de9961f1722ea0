"""What walks with ground truth say of a tracker and a regressor: drift, noise, true sigmas."""
