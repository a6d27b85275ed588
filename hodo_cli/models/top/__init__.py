"""The Lagrange top without its forms: its torques as functions of slow time, and its nutation.
Imports no model."""
