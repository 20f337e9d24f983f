//! Boards: their pins and names, and all functions of a 7I97.

pub mod board_7i97;
mod manifest;
mod others;
