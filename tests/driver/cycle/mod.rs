//! The cycle: the values that it moves, the pins that it processes, its trace.

pub mod arbitrary_values;
mod changed_pins;
mod own_pins;
mod trace;
mod values;
