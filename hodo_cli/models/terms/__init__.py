"""The torques that models are sums of, one small function each, the laws of time that their
coefficients follow, their events, and a body under any sum. Imports the rigid body and its theory,
no model."""
