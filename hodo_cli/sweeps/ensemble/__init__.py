"""Many motions of one model side by side: their ends, their samples, and the zeros of an event's
function. Imports engines, integration and models.

What `integrate` and `classify` do for one case is done here for arrays of them, step by step. A
motion of which anything is uncertain (too near the separatrix, too stiff, at rest, zeros that do
not alternate) is not accepted, and these two decide it by themselves.
"""
