"""Many motions of one model, integrated side by side: their ends, their samples, and the zeros of
an event's function. Imports engines, integration and models.

This package does for arrays of motions, step by step, what `integrate` and `classify` do for one
case. It does not accept a motion with anything uncertain (too near the separatrix, too stiff, at
rest, zeros that do not alternate); `integrate` and `classify` then decide that motion alone.
"""
