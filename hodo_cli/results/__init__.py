"""Result files: their names, how they are written, resumed, changed, checked and read. The only
importer of h5py; imports integration, batch and what lies below."""
