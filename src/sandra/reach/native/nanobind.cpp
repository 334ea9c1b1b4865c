// nanobind's own code, compiled into the module.
#include "nb_combined.cpp"
