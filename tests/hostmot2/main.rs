//! HostMot2: what a firmware says about itself.

mod identify;
