"""Sweeps: a case with a `sweep:` block has many members, each reduced to a few numbers. Imports
results and the layers below."""
