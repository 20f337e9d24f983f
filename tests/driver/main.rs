//! The driver on simulated boards, by subject: a folder for each.

mod boards;
#[path = "../common/mod.rs"]
mod common;
mod cycle;
mod encoders;
mod events;
mod faults;
mod inputs;
mod outputs;
mod pace;
mod parameters;
mod positions;
mod remotes;
mod reset;
mod setup;
mod steppers;
mod stop;
