"""``python -m motion_gym`` is the command ``motion-gym``."""

from motion_gym.cli.main import main

main()
