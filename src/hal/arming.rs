//! Arming of a group: whether its outputs follow the application, and when they will again.

/// Whether the outputs of a group follow the application.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Arming {
    /// The outputs follow the application.
    Armed,
    /// The outputs are safe until the application re-arms the group.
    Safe,
    /// The outputs are safe until this condition is met.
    Awaited(ArmingCondition),
}

/// Condition under which a group is armed without a further call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ArmingCondition {
    /// The board has its set-up again; from then on as [`Running`](Self::Running).
    SetUp,
    /// The next good transfer, if the group comes up because of the board.
    WithBoard,
    /// The next good transfer, however many attempts a remote needs.
    Running,
}

/// What may change the arming of a group.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ArmingEvent {
    /// A fault of the group, or of the board.
    Fault,
    /// A remote that ran went offline.
    Offline,
    /// A remote that ran went offline, and comes back with the board.
    OfflineWithBoard,
    /// The port of a remote is switched off.
    PortOff,
    /// A good transfer, with inputs that are valid.
    GoodTransfer,
    /// The application arms a group whose inputs are valid.
    Rearm,
    /// The application asks for it.
    Request(ArmingCondition),
    /// The request is withdrawn.
    Cancel,
    /// The request is withdrawn, unless it waits for the set-up of the board.
    CancelTransfer,
    /// The board has its set-up again.
    SetUp,
}

impl Arming {
    /// The arming after an event: all transitions there are.
    #[expect(clippy::match_same_arms, reason = "a table")]
    pub const fn after(self, event: ArmingEvent) -> Self {
        use ArmingCondition::{Running, SetUp, WithBoard};
        use ArmingEvent as On;
        match (event, self) {
            // What waits for the set-up waits for what the fault has taken.
            (On::Fault | On::Offline, Self::Awaited(SetUp)) => self,
            (On::OfflineWithBoard, Self::Awaited(_)) => self,
            (On::Fault | On::Offline | On::OfflineWithBoard | On::PortOff, _) => Self::Safe,
            (On::GoodTransfer, Self::Awaited(WithBoard | Running)) => Self::Armed,
            (On::Rearm, _) => Self::Armed,
            (On::Request(_), Self::Armed) => self,
            // A weaker request leaves the one before.
            (On::Request(WithBoard), Self::Awaited(_)) => self,
            (On::Request(condition), _) => Self::Awaited(condition),
            (On::Cancel, Self::Awaited(_)) => Self::Safe,
            (On::CancelTransfer, Self::Awaited(WithBoard | Running)) => Self::Safe,
            (On::SetUp, Self::Awaited(SetUp)) => Self::Awaited(Running),
            (On::GoodTransfer | On::Cancel | On::CancelTransfer | On::SetUp, _) => self,
        }
    }

    /// True if the outputs follow the application.
    pub const fn is_armed(self) -> bool {
        matches!(self, Self::Armed)
    }

    /// True if the group will be armed without a further call.
    pub const fn is_awaited(self) -> bool {
        matches!(self, Self::Awaited(_))
    }
}

impl ArmingEvent {
    /// True for a fault: everything that was set before is forgotten.
    pub const fn is_fault(self) -> bool {
        matches!(self, Self::Fault | Self::PortOff) || self.is_loss()
    }

    /// True for the fault of a group that ran, whether it was armed or not.
    pub const fn is_loss(self) -> bool {
        matches!(self, Self::Offline | Self::OfflineWithBoard)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The arming as two independent states, one changed by each call: what the table replaces.
    #[derive(Clone, Copy, Debug)]
    struct Flags {
        armed: bool,
        awaited: Option<ArmingCondition>,
    }

    impl Flags {
        fn take(&mut self, event: ArmingEvent) {
            let awaited = self.awaited;
            match event {
                ArmingEvent::Fault | ArmingEvent::Offline => {
                    if awaited != Some(ArmingCondition::SetUp) {
                        self.awaited = None;
                    }
                    self.armed = false;
                }
                ArmingEvent::OfflineWithBoard => {
                    self.take(ArmingEvent::Fault);
                    if Self::awaits_transfer(awaited) {
                        self.awaited = awaited;
                    }
                }
                ArmingEvent::PortOff => {
                    self.take(ArmingEvent::Cancel);
                    self.take(ArmingEvent::Fault);
                }
                ArmingEvent::GoodTransfer => {
                    if Self::awaits_transfer(awaited) {
                        *self = Self {
                            armed: true,
                            awaited: None,
                        };
                    }
                }
                ArmingEvent::Rearm => {
                    self.take(ArmingEvent::Request(ArmingCondition::Running));
                    self.take(ArmingEvent::GoodTransfer);
                }
                ArmingEvent::Request(when) => {
                    let is_weaker = awaited.is_some() && when == ArmingCondition::WithBoard;
                    if !self.armed && !is_weaker {
                        self.awaited = Some(when);
                    }
                }
                ArmingEvent::Cancel => self.awaited = None,
                ArmingEvent::CancelTransfer => {
                    if Self::awaits_transfer(awaited) {
                        self.awaited = None;
                    }
                }
                ArmingEvent::SetUp => {
                    if awaited == Some(ArmingCondition::SetUp) {
                        self.awaited = Some(ArmingCondition::Running);
                    }
                }
            }
        }

        fn awaits_transfer(awaited: Option<ArmingCondition>) -> bool {
            let with_transfer = [ArmingCondition::WithBoard, ArmingCondition::Running];
            awaited.is_some_and(|when| with_transfer.contains(&when))
        }
    }

    fn event() -> impl Strategy<Value = ArmingEvent> {
        use ArmingCondition::{Running, SetUp, WithBoard};
        prop_oneof![
            Just(ArmingEvent::Fault),
            Just(ArmingEvent::Offline),
            Just(ArmingEvent::OfflineWithBoard),
            Just(ArmingEvent::PortOff),
            Just(ArmingEvent::GoodTransfer),
            Just(ArmingEvent::Rearm),
            proptest::sample::select(vec![SetUp, WithBoard, Running])
                .prop_map(ArmingEvent::Request),
            Just(ArmingEvent::Cancel),
            Just(ArmingEvent::CancelTransfer),
            Just(ArmingEvent::SetUp),
        ]
    }

    proptest! {
        #[test]
        fn table_does_what_the_two_flags_did(events in proptest::collection::vec(event(), 0..40)) {
            let mut arming = Arming::Armed;
            let mut flags = Flags { armed: true, awaited: None };
            for event in events {
                arming = arming.after(event);
                flags.take(event);
                prop_assert_eq!(arming == Arming::Armed, flags.armed, "after {:?}", event);
                let awaited = match arming {
                    Arming::Awaited(condition) => Some(condition),
                    Arming::Armed | Arming::Safe => None,
                };
                prop_assert_eq!(awaited, flags.awaited, "after {:?}", event);
            }
        }
    }

    #[test]
    fn only_rearming_or_a_request_leads_from_safe_to_armed() {
        let without_request = [
            ArmingEvent::Fault,
            ArmingEvent::Offline,
            ArmingEvent::OfflineWithBoard,
            ArmingEvent::PortOff,
            ArmingEvent::GoodTransfer,
            ArmingEvent::Cancel,
            ArmingEvent::CancelTransfer,
            ArmingEvent::SetUp,
        ];
        for event in without_request {
            assert_eq!(Arming::Safe.after(event), Arming::Safe, "{event:?}");
        }
    }
}
