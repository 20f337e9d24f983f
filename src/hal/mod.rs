//! Typed pins and parameters, LinuxCNC names, and the visitor that lists them.
