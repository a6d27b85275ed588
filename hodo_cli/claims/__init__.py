"""Verdicts on the statements of a text: general checks, those of one paper each in a module of its
own, and what makes them a verdict. Imports sweeps and what lies below; knows no figure."""
