"""What can be said of a motion without integrating it: which crossings torques allow, the motion
and attitude of a free body, and the principal axes of a tensor. Imports no model."""
