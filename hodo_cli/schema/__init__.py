"""Declared keys, their checks and descriptions, and YAML text that knows its places. Imports
nothing of the package: no mechanics, no numpy."""
