"""What can be said of a motion without integrating it: possible crossings, rotors,
and the motion and attitude of a free body. Imports no model, only the rigid body."""
