"""Results on a motion without its integration: which crossings the torques allow, and the motion
and attitude of a free body in closed form. Imports no model."""
