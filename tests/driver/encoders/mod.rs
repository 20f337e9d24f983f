//! Encoders: counts, settings, velocity, index and probe.

mod between_counts;
mod board_7i97;
mod index;
mod two_cards;
