//! Events as words, which another thread can take without a lock.

use super::{Event, EventKind};
use crate::bus::{BusErrorKind, Instant};
use crate::hostmot2::RemoteId;
use crate::packed::{packed, packed_word};
use crate::sslbp::{RemoteLabel, RemoteName};

/// All kinds of bus errors, in the order of their numbers in an event.
const BUS_ERRORS: [BusErrorKind; 10] = [
    BusErrorKind::Late,
    BusErrorKind::Lost,
    BusErrorKind::Stale,
    BusErrorKind::Refused,
    BusErrorKind::Unreachable,
    BusErrorKind::Short,
    BusErrorKind::Invalid,
    BusErrorKind::Occupied,
    BusErrorKind::Device,
    BusErrorKind::Other,
];

packed!(Event {
    at: Instant,
    cycle: u64,
    kind: EventKind,
});
// The address, 1 if there is a name, and the name.
packed_word!(
    RemoteLabel,
    |remote| {
        let RemoteId { port, channel } = remote.id;
        let [a, b, c, d] = remote.name.unwrap_or_default().0;
        let is_named = remote.name.is_some().into();
        u64::from_le_bytes([port, channel, is_named, 0, a, b, c, d])
    },
    |word| {
        let [port, channel, is_named, _, name @ ..] = word.to_le_bytes();
        Some(Self {
            id: RemoteId { port, channel },
            name: (is_named != 0).then_some(RemoteName(name)),
        })
    },
);
packed_word!(BusErrorKind, |kind| *kind as u64, |number| BUS_ERRORS
    .get(usize::try_from(number).ok()?)
    .copied(),);

impl EventKind {
    /// A number for each reason with which an event may repeat.
    pub(super) const fn reason(self) -> u32 {
        match self {
            Self::NotThere { .. } => (BUS_ERRORS.len() as u32).saturating_add(1),
            Self::TransferFailed { failure, .. } => failure as u32,
            Self::ReadFailed { why } | Self::WriteFailed { why } => why as u32,
            _ => 0,
        }
    }
}

#[cfg(all(test, feature = "std"))]
mod tests {
    use super::super::Repeating;
    use super::*;
    use crate::packed::tests::{again, every};
    use crate::packed::{Packed, Variants};
    use crate::sslbp::Failure;
    use alloc::string::ToString;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn event_words_round_trip_for_any_valid_words(
            at in any::<u64>(), cycle in any::<u64>(), kind in 0..EventKind::COUNT as u64,
            fields in proptest::collection::vec(
                prop_oneof![0u64..16, any::<u64>()], EventKind::WORDS - 1,
            ),
        ) {
            let mut words = [at, cycle, kind].into_iter().chain(fields);
            if let Some(event) = Event::unpack(&mut words) {
                prop_assert_eq!(event.at.as_nanos(), at);
                prop_assert_eq!(event.cycle, cycle);
                prop_assert_eq!(again(&event), Some(event));
                prop_assert!(!event.to_string().is_empty());
            }
        }
    }

    #[test]
    fn every_kind_of_event_has_words_and_a_bit() {
        let kinds = every::<EventKind>(&[1, 2]);
        let mut all = 0;
        for kind in &kinds {
            assert_eq!(again(kind), Some(*kind));
            let bit = kind.mask().bits();
            assert_eq!((bit.count_ones(), all & bit), (1, 0), "{kind:?}");
            all |= bit;
        }
        assert_eq!(all, super::super::EventMask::all().bits());
        for what in every::<Repeating>(&[0x0201]) {
            assert_eq!(again(&what), Some(what));
            assert!(!what.to_string().is_empty());
        }
    }

    #[test]
    fn each_field_of_an_event_comes_back() {
        use crate::events::OfflineReason;
        let id = RemoteId::new(1, 7);
        let unnamed = RemoteLabel::from(id);
        assert_eq!(again(&unnamed), Some(unnamed));
        let remote = RemoteLabel::new(id, RemoteName(*b"7I77"));
        for why in BUS_ERRORS {
            let kind = EventKind::ReadFailed { why };
            assert_eq!(again(&kind), Some(kind));
        }
        for failure in Failure::ALL {
            let kind = EventKind::TransferFailed { remote, failure };
            assert_eq!(again(&kind), Some(kind));
        }
        for reason in every::<OfflineReason>(&[8, 0x8765_4321]) {
            let kind = EventKind::RemoteStaysOffline { remote, reason };
            assert_eq!(again(&kind), Some(kind));
            assert_eq!(kind.remote(), Some(remote));
        }
    }

    #[test]
    fn repeating_reasons_have_distinct_bits() {
        let reads = BUS_ERRORS.map(|why| EventKind::ReadFailed { why }.reason());
        let not_there = EventKind::NotThere { found: 3 }.reason();
        let all: alloc::collections::BTreeSet<_> = reads.into_iter().chain([not_there]).collect();
        assert_eq!(all.len(), BUS_ERRORS.len() + 1);
        assert!(all.iter().all(|reason| *reason < u32::BITS));
        assert!(Failure::ALL.len() < u32::BITS as usize);
    }
}
