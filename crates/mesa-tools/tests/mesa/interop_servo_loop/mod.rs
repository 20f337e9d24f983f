//! The programs of these packages in real use: processes, real sockets, signals, the clock.

mod ending;
mod servo_loop;
