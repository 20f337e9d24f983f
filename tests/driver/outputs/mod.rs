//! Outputs: enables, limits, arming and re-arming.

mod axis_enables;
mod limits;
mod not_armed;
mod rearm;
mod rearm_when_running;
mod second_fault;
