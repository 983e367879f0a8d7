"""What a measurement was made on."""

import datetime
import os
import platform


def machine() -> str:
    """Date, processor, cores used, Python and numpy, in a line."""
    import numpy

    processor = platform.processor() or platform.machine()
    try:
        with open("/proc/cpuinfo") as file:
            processor = next(line.split(":", 1)[1].strip() for line in file if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return (
        f"{datetime.date.today()}, {processor}, {cores} cores, {platform.system()}, "
        f"Python {platform.python_version()}, numpy {numpy.__version__}"
    )
