"""The domains, one file each; import them as ``motion_gym.envs``."""
