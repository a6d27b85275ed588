"""Ensembles: a case with a `sweep:` block as many members, reduced to a few numbers each. Imports
results and what lies below."""
