//! Buses: LBP16 over UDP, recording and fault-injecting wrappers.

pub mod udp;
