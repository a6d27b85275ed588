"""The functions that equations of a model may use: of numbers, of arrays in any precision, and of
whatever an engine puts in their place."""

from .arithmetic import abs, cos, exp, hypot, log, sin, sqrt

__all__ = ["abs", "cos", "exp", "hypot", "log", "sin", "sqrt"]
