//! Resets and bites of the board: their detection at every moment, and what they leave valid.

mod absent_remotes;
mod during_cycle;
mod during_read;
mod during_start;
mod io_directions;
mod reported;
mod restored;
