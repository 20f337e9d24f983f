//! Second names of pins and parameters.

use alloc::string::String;

use super::maker::{for_one_more, is_name};
use super::{PinError, PinId, PinStore, Pins};

impl Pins {
    /// Second names, each with the pin or parameter that it names, in the order of the names. They
    /// are found like the first name, [`PinInfo::name`](super::PinInfo::name).
    ///
    /// With [`Defaults::LinuxCnc`](crate::driver::Defaults::LinuxCnc) they are those that LinuxCNC
    /// makes: `hm2_7i97.0.pwmgen.00.out0.invert_output` for `hm2_7i97.0.gpio.000.invert_output`.
    pub fn aliases(&self) -> impl Iterator<Item = (&str, PinId)> {
        let aliases = self.aliases.iter();
        aliases.map(|(alias, index)| (&**alias, PinId::new(self.key(*index))))
    }

    /// Index of the pin or parameter with a second name.
    pub(super) fn aliased(&self, alias: &str) -> Option<u32> {
        let (_, index) = self.aliases.get(self.rank_of_alias(alias).ok()?)?;
        Some(*index)
    }

    fn rank_of_alias(&self, alias: &str) -> Result<usize, usize> {
        self.aliases
            .binary_search_by(|(name, _)| (**name).cmp(alias))
    }
}

/// Set-up. Allocates.
impl PinStore {
    /// Gives a pin or parameter a second name, as LinuxCNC's `hal_param_alias`.
    ///
    /// ```
    /// use mesa_hal::hal::{PinError, PinMaker, PinStore};
    /// # fn main() -> Result<(), PinError> {
    /// let mut store = PinStore::default();
    /// let group = store.add_group();
    /// let inverted = PinMaker::new(&mut store, group, "board.gpio.000.").setting("invert", false)?;
    /// store.add_alias(inverted, "board.spindle.invert")?;
    /// assert_eq!(store.parameter("board.spindle.invert"), Ok(inverted));
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`PinError::BadName`], [`PinError::NameTaken`], and [`PinError::ForeignHandle`] for a pin of
    /// another store.
    pub fn add_alias(
        &mut self,
        pin: impl Into<PinId>,
        alias: impl Into<String>,
    ) -> Result<(), PinError> {
        let (pin, name) = (pin.into(), alias.into());
        if self.info_of(pin).is_none() {
            return Err(PinError::ForeignHandle);
        }
        if !is_name(&name) {
            return Err(PinError::BadName { name });
        }
        match self.rank_of_alias(&name) {
            Err(rank) if self.rank_of(&name).is_err() => {
                let aliases = for_one_more(&mut self.aliases);
                aliases.insert(rank, (name, pin.index() as u32));
                Ok(())
            }
            _ => Err(PinError::NameTaken { name }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hal::{PinMaker, Role};
    use alloc::vec::Vec;

    #[test]
    fn both_names_find_a_parameter_and_no_name_is_given_twice() {
        let mut store = PinStore::default();
        let group = store.add_group();
        let mut make = PinMaker::new(&mut store, group, "card.");
        let one = make.setting("one", false).expect("made");
        let two = make.setting("two", 2).expect("made");
        for (pin, alias) in [(PinId::from(two), "card.b"), (one.into(), "card.a")] {
            store.add_alias(pin, alias).expect("a new name");
        }
        assert_eq!(store.parameter("card.a"), Ok(one));
        assert_eq!(store.parameter("card.one"), Ok(one));
        assert_eq!(store.id("card.b"), Ok(two.into()));
        let aliases: Vec<_> = store.aliases().collect();
        assert_eq!(aliases, [("card.a", one.into()), ("card.b", two.into())]);
        assert_eq!(store.infos()[0].role, Role::Setting);
        for taken in ["card.a", "card.two"] {
            let name = taken.into();
            assert_eq!(
                store.add_alias(one, taken),
                Err(PinError::NameTaken { name })
            );
        }
        let name = String::from("card.b");
        let made = PinMaker::new(&mut store, group, "card.").input::<bool>("b");
        assert_eq!(made, Err(PinError::NameTaken { name }));
        let name = String::from("a b");
        assert_eq!(store.add_alias(one, "a b"), Err(PinError::BadName { name }));
        let foreign = PinStore::default().add_alias(one, "card.c");
        assert_eq!(foreign, Err(PinError::ForeignHandle));
        assert!(store.id("card.c").is_err());
    }
}
