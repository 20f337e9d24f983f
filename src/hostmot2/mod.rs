//! HostMot2: cookie, IDROM, module and pin descriptors, and one file for each kind of module.
