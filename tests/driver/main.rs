//! The driver on simulated boards: set-up, the cycle, faults, resets, the pace, the end.

#[path = "../common/mod.rs"]
mod common;
mod cycle;
mod cycle_7i97;
mod devices;
mod dpll_lock;
#[cfg(feature = "log")]
mod dropped;
mod enabling;
mod events;
mod events_by_fault;
mod faults_board;
mod faults_outputs;
mod faults_remote;
mod foreign_watchdog;
mod index_on_network;
mod late_host;
mod late_reply;
#[cfg(feature = "log")]
mod logged;
mod low_line;
mod manifest;
mod not_armed;
mod only_what_changed;
mod optional_remotes;
mod other_board;
mod other_boards;
mod outputs_forgotten;
mod pace;
mod read_late;
mod rearmed_once;
mod refused_start;
mod remote_parameters;
mod remotes_by_chance;
mod reset_evidence;
mod reset_forgets;
mod reset_in_read;
mod reset_in_start;
mod reset_named;
mod reset_overtakes;
mod set_up;
mod stale;
mod stop_tells;
mod trace;
mod two_cards;
mod unread;
mod watchdogs_proved;
