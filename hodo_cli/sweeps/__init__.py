"""Ensembles: a case with a `sweep:` block as many members, reduced to a few numbers each."""
