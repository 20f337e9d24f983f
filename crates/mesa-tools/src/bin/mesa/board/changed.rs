//! Target board of a command that changes it: with consent, or as a dry run.

use std::fmt::{self, Display};

use clap::Args;
use serde::Serialize;

use super::address::BoardAddress;
use super::target::{Found, Target};
use crate::board::consent::{Asks, Plan};
use crate::ui::context::{Context, Failure};

/// Target board of a command that changes it.
#[derive(Clone, Debug, Args)]
pub struct ChangedTarget {
    #[command(flatten)]
    target: Target,
    /// Check everything and print the planned action without doing it
    #[arg(long)]
    pub dry_run: bool,
    #[command(flatten)]
    pub asks: Asks,
}

impl ChangedTarget {
    /// As [`Target::find`].
    pub fn find(&self, context: &Context) -> Result<Found, Failure> {
        self.target.find(context)
    }
}

/// Planned action on a board, as `--dry-run` prints it.
#[derive(Debug, Serialize)]
struct Planned<'a> {
    /// Always true: nothing was done.
    dry_run: bool,
    address: BoardAddress,
    would: &'a str,
}

impl Context {
    /// Asks for [consent](Asks::consent) to an action on a board, with its verb in the infinitive.
    /// With `--dry-run` prints the action instead and returns `false`.
    pub fn agrees(
        &self,
        target: &ChangedTarget,
        found: &Found,
        action: &str,
    ) -> Result<bool, Failure> {
        let address = found.address;
        if !target.dry_run {
            let plan = Plan::at(address, action);
            target.asks.consent_to_change(self, &plan, Some(found))?;
            return Ok(true);
        }
        self.print(&Planned {
            dry_run: true,
            address,
            would: action,
        })?;
        Ok(false)
    }
}

impl Display for Planned<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { address, would, .. } = self;
        writeln!(f, "{address}: would {would}; nothing was done")
    }
}
