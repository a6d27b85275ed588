"""What can be said of a motion without integrating it: which crossings torques allow, and
the motion and attitude of a free body. Imports no model, only the rigid body."""
