"""Declared keys, their checks and descriptions, and YAML text that knows its places. No mechanics,
no numpy."""
