"""On PYTHONPATH, this hides what Windows does not have from an interpreter and from the processes
that it starts."""

import os
import signal
import sys

for name in ("fcntl", "heyoka", "resource"):
    sys.modules[name] = None  # type: ignore[assignment]
del os.chown, os.sysconf, signal.pthread_sigmask
