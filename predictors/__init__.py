"""The predictors, one file each; import them as ``motion_gym.predictors``."""
