//! What pins exist: their names and descriptions.

use alloc::string::String;
use alloc::sync::Arc;
use alloc::vec::Vec;
use core::sync::atomic::{AtomicU32, Ordering};

use super::handle::Key;
use super::nearest::{is_end, nearest};
use super::room::for_one_more;
use super::{Handle, MAX_NAME, MAX_PINS, PinError, PinId, PinInfo, Place, Role, Value};

/// Number of the next catalog; 0 belongs to none.
static NEXT_STORE: AtomicU32 = AtomicU32::new(1);

/// Number of the newest pins whose places are compared with that of a new one.
const NEIGHBOURS: usize = 32;

/// The pins and parameters that exist. Immutable after the set-up; a [`Key`] of this catalog refers
/// to one of them by its index.
#[derive(Debug)]
pub(super) struct Catalog {
    /// The store's own number.
    store: u32,
    infos: Vec<PinInfo>,
    /// Indices into `infos`, in the order of the names there.
    by_name: Vec<u32>,
    /// Second names in their order, with indices into `infos`.
    aliases: Vec<(String, u32)>,
    /// The place of a pin without a terminal.
    nowhere: Arc<Place>,
}

impl Default for Catalog {
    fn default() -> Self {
        Self {
            // Wraps around after 2^32 stores, and is never 0.
            store: NEXT_STORE.fetch_add(1, Ordering::Relaxed).max(1),
            infos: Vec::new(),
            by_name: Vec::new(),
            aliases: Vec::new(),
            nowhere: Arc::default(),
        }
    }
}

/// Ranks of a new name, which no pin or parameter has.
#[derive(Clone, Copy, Debug)]
pub(super) struct NewName {
    among_names: usize,
    among_aliases: usize,
}

impl Catalog {
    pub const fn key(&self, index: u32) -> Key {
        Key {
            store: self.store,
            index,
        }
    }

    /// The index of a pin, or of a part of a group; `None` for one of another store.
    #[inline]
    pub fn index(&self, key: Key) -> Option<usize> {
        (key.store == self.store).then_some(key.index as usize)
    }

    pub fn infos(&self) -> &[PinInfo] {
        &self.infos
    }

    pub fn info(&self, key: Key) -> Option<&PinInfo> {
        self.infos.get(self.index(key)?)
    }

    /// The pin or parameter with the given first or second name, and its index.
    pub fn named(&self, name: &str) -> Option<(u32, &PinInfo)> {
        let index = match self.rank_of(name) {
            Ok(rank) => *self.by_name.get(rank)?,
            Err(_) => self.aliases.get(self.rank_of_alias(name).ok()?)?.1,
        };
        Some((index, self.infos.get(index as usize)?))
    }

    /// The handle of the pin or parameter with the given name.
    pub fn handle<K, T: Value>(&self, name: &str, role: Role) -> Result<Handle<K, T>, PinError> {
        let (index, info) = self.named(name).ok_or_else(|| self.not_found(name))?;
        let wrong = |expected, actual| {
            let name = name.into();
            Err(PinError::WrongKind {
                name,
                expected,
                actual,
            })
        };
        if info.role != role && !(role.is_param() && info.role.is_param()) {
            return wrong(role.as_str(), info.role.as_str());
        }
        if info.hal_type != T::TYPE {
            return wrong(T::TYPE.as_str(), info.hal_type.as_str());
        }
        Ok(Handle::new(self.key(index)))
    }

    /// Second names, each with the pin or parameter that it names, in the order of the names.
    pub fn aliases(&self) -> impl Iterator<Item = (&str, PinId)> {
        let aliases = self.aliases.iter();
        aliases.map(|(alias, index)| (&**alias, PinId::new(self.key(*index))))
    }

    /// Error for an unknown name, with the nearest name. Allocates.
    pub fn not_found(&self, name: &str) -> PinError {
        PinError::NotFound {
            name: name.into(),
            nearest: self.nearest(name),
        }
    }

    /// The name that was probably meant: for the enable of an output the pin that does enable it,
    /// whatever its name, else the [nearest](nearest).
    pub fn nearest(&self, wanted: &str) -> Option<String> {
        let (stem, suffix) = wanted.rsplit_once(['-', '.']).unwrap_or_default();
        let is_enable = suffix
            .get(..3)
            .is_some_and(|s| s.eq_ignore_ascii_case("ena"));
        let mut outputs = self.infos.iter().filter(|_| is_enable);
        let output = outputs.find(|info| {
            info.enabled_by.is_some()
                && (info.name.eq_ignore_ascii_case(stem) || is_end(&info.name, stem))
        });
        let enable = output.and_then(|output| self.info(output.enabled_by?.key()));
        let enable = enable.map(|enable| enable.name.clone());
        enable.or_else(|| nearest(self.infos.iter().map(|info| &*info.name), wanted))
    }

    /// Rank of a name among all names; as an error the rank that it would have.
    fn rank_of(&self, name: &str) -> Result<usize, usize> {
        let at = |index: u32| self.infos.get(index as usize).map(|info| &*info.name);
        self.by_name
            .binary_search_by(|&index| at(index).cmp(&Some(name)))
    }

    fn rank_of_alias(&self, alias: &str) -> Result<usize, usize> {
        self.aliases
            .binary_search_by(|(name, _)| (**name).cmp(alias))
    }
}

/// Set-up. Allocates.
impl Catalog {
    /// Checks that a name can be given to a new pin, or to a pin as its second name.
    pub fn check_new(&self, name: &str) -> Result<NewName, PinError> {
        if !is_name(name) {
            return Err(PinError::BadName { name: name.into() });
        }
        match (self.rank_of(name), self.rank_of_alias(name)) {
            (Err(among_names), Err(among_aliases)) => Ok(NewName {
                among_names,
                among_aliases,
            }),
            _ => Err(PinError::NameTaken { name: name.into() }),
        }
    }

    /// The index of the next pin.
    pub fn next_index(&self) -> Result<u32, PinError> {
        let count = self.infos.len();
        (count < MAX_PINS)
            .then_some(count as u32)
            .ok_or(PinError::TooMany)
    }

    /// Adds a pin with the next index, under a name that was checked.
    pub fn add(&mut self, name: NewName, info: PinInfo) {
        let index = self.infos.len() as u32;
        for_one_more(&mut self.by_name).insert(name.among_names, index);
        for_one_more(&mut self.infos).push(info);
    }

    /// Gives a pin a second name.
    pub fn add_alias(&mut self, pin: PinId, alias: String) -> Result<(), PinError> {
        if self.info(pin.key()).is_none() {
            return Err(PinError::ForeignHandle);
        }
        let name = self.check_new(&alias)?;
        for_one_more(&mut self.aliases).insert(name.among_aliases, (alias, pin.index() as u32));
        Ok(())
    }

    /// Declares that an output needs the pin `by`; returns false if one of them is of another
    /// store.
    pub fn set_enabled_by(&mut self, output: PinId, by: PinId) -> bool {
        let are_own = [output, by].map(|pin| self.info(pin.key()).is_some()) == [true; 2];
        if are_own && let Some(info) = self.infos.get_mut(output.index()) {
            info.enabled_by = Some(by);
        }
        are_own
    }

    /// The place of a new pin: that of one of the newest pins, if it is the same.
    pub fn shared(&self, place: Place) -> Arc<Place> {
        if place.terminal.is_empty() && place.signal.is_empty() {
            return Arc::clone(&self.nowhere);
        }
        let newest = self.infos.iter().rev().take(NEIGHBOURS);
        let same = newest.map(|info| &info.place).find(|at| ***at == place);
        same.map_or_else(|| Arc::new(place), Arc::clone)
    }

    /// Removes all pins from index `count` on, and their names.
    pub fn truncate(&mut self, count: usize) {
        let first = count as u32;
        self.infos.truncate(count);
        self.by_name.retain(|&index| index < first);
        self.aliases.retain(|&(_, index)| index < first);
    }

    /// Releases the memory that was kept for further pins.
    pub fn shrink_to_fit(&mut self) {
        self.infos.shrink_to_fit();
        self.by_name.shrink_to_fit();
        self.aliases.shrink_to_fit();
    }
}

/// True if LinuxCNC accepts the name: length within its limit, and no space, quote or other
/// character that ends a word in a HAL file.
pub(super) fn is_name(name: &str) -> bool {
    let fits =
        |c: char| c.is_ascii_graphic() && !matches!(c, '"' | '\'' | '#' | '$' | '[' | ']' | '=');
    (1..=MAX_NAME).contains(&name.len()) && name.chars().all(fits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hal::{PinMaker, PinStore, Role};
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
