//! The simulated board as a program.

mod board;
mod control;
mod machine;
mod watch;
