"""Solvers behind one protocol, one heavy library each. Imports models and schema."""
