"""The torques that models are sums of, one small function each, and the laws of time that their
coefficients follow. Imports schema and arithmetic only."""
