//! HostMot2: a firmware's description of itself.

mod identify;
