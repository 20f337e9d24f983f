//! The pace of the cycle: by the board's clock, and by the host with the DPLL.

mod by_board;
mod dpll_lock;
mod pacer;
mod set_period;
