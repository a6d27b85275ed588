"""Averages over the turns of a body's hodograph: its free motion by slow variables and phase, means
over a turn, and the passage through the separatrix. Imports no other model, only the rigid body."""
