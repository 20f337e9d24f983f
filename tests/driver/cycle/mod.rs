//! The cycle: the values that it moves, the pins that it processes, a log of its words.

pub mod arbitrary_values;
mod changed_pins;
mod listened;
mod own_pins;
mod recorded;
mod values;
