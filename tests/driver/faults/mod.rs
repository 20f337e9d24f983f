//! Faults of boards, buses, remotes and cables, and of the host: what is safe, and what goes on.

mod another_board;
mod board;
mod buses;
mod foreign_watchdog;
mod host_delays;
mod line_low;
mod random;
mod remote;
pub mod remote_outputs;
mod stuck_port;
