"""The Lagrange top: its forms, its torques as functions of slow time, and its nutation."""
