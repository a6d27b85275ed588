"""Files of labelled arrays: how they are written, checked, resumed, changed and read, so that no
kill and no damage loses anything. The only importer of h5py; knows no mechanics."""
