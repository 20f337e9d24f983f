//! Input and output: what a person types, what is printed, and how a command ends.

pub mod colours;
pub mod context;
pub mod files;
pub mod full_screen;
pub mod hurry;
pub mod input;
pub mod number;
pub mod output;
pub mod picture;
pub mod stamp;
