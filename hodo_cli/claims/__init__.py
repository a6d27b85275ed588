"""Verdicts on the statements of a text: the kinds of check, and how findings become a verdict.
Imports sweeps and the folders below; knows no figure and no paper."""
