"""On PYTHONPATH, this gives an interpreter, and the processes that it starts, a heyoka without
quadruple precision: that of macOS, of Windows, and of Linux before 7.13."""

import heyoka

heyoka.__dict__.pop("real128", None)
