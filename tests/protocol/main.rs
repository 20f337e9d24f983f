//! The wire formats and the smart-serial port: LBP and LBP16 against their manuals, SSLBP against
//! the recorded behaviour of Mesa's gateware, on the simulated FPGA, and on registers with
//! arbitrary contents.

#[path = "../common/mod.rs"]
mod common;
mod lbp;
mod lbp16;
mod sslbp_hostile;
mod sslbp_recorded;
mod sslbp_simulated;
mod sslbp_stepped;
