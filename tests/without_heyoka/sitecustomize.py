"""On PYTHONPATH, this hides heyoka from an interpreter and from the processes that it starts."""

import sys

sys.modules["heyoka"] = None  # type: ignore[assignment]
