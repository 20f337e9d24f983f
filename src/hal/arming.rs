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
    /// A good transfer, with inputs that are valid.
    GoodTransfer,
    /// The application asks for it.
    Request(ArmingCondition),
    /// The request is withdrawn.
    Cancel,
    /// The board has its set-up again.
    SetUp,
}

impl Arming {
    /// The arming after an event: all transitions there are.
    #[expect(clippy::match_same_arms, reason = "a table")]
    pub const fn after(self, event: ArmingEvent) -> Self {
        use ArmingCondition::{Running, SetUp, WithBoard};
        match (event, self) {
            // Who waits for the set-up waits for what the fault has taken.
            (ArmingEvent::Fault, Self::Awaited(SetUp)) => self,
            (ArmingEvent::Fault, _) => Self::Safe,
            (ArmingEvent::GoodTransfer, Self::Awaited(WithBoard | Running)) => Self::Armed,
            // A weaker request leaves the one before.
            (ArmingEvent::Request(WithBoard), Self::Awaited(_)) => self,
            (ArmingEvent::Request(condition), Self::Safe | Self::Awaited(_)) => {
                Self::Awaited(condition)
            }
            (ArmingEvent::Cancel, Self::Awaited(_)) => Self::Safe,
            (ArmingEvent::SetUp, Self::Awaited(SetUp)) => Self::Awaited(Running),
            (
                ArmingEvent::GoodTransfer
                | ArmingEvent::Request(_)
                | ArmingEvent::Cancel
                | ArmingEvent::SetUp,
                _,
            ) => self,
        }
    }

    /// The condition of a group that the next good transfer arms.
    pub const fn awaits_transfer(self) -> Option<ArmingCondition> {
        match self {
            Self::Awaited(condition @ (ArmingCondition::WithBoard | ArmingCondition::Running)) => {
                Some(condition)
            }
            _ => None,
        }
    }

    /// True if the group will be armed without a further call.
    pub const fn is_awaited(self) -> bool {
        matches!(self, Self::Awaited(_))
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
            match event {
                ArmingEvent::Fault => {
                    if self.awaited != Some(ArmingCondition::SetUp) {
                        self.awaited = None;
                    }
                    self.armed = false;
                }
                ArmingEvent::GoodTransfer => {
                    let with_transfer = [ArmingCondition::WithBoard, ArmingCondition::Running];
                    if self
                        .awaited
                        .is_some_and(|when| with_transfer.contains(&when))
                    {
                        *self = Self {
                            armed: true,
                            awaited: None,
                        };
                    }
                }
                ArmingEvent::Request(when) => {
                    let is_weaker = self.awaited.is_some() && when == ArmingCondition::WithBoard;
                    if !self.armed && !is_weaker {
                        self.awaited = Some(when);
                    }
                }
                ArmingEvent::Cancel => self.awaited = None,
                ArmingEvent::SetUp => {
                    if self.awaited == Some(ArmingCondition::SetUp) {
                        self.awaited = Some(ArmingCondition::Running);
                    }
                }
            }
        }
    }

    fn event() -> impl Strategy<Value = ArmingEvent> {
        use ArmingCondition::{Running, SetUp, WithBoard};
        prop_oneof![
            Just(ArmingEvent::Fault),
            Just(ArmingEvent::GoodTransfer),
            proptest::sample::select(vec![SetUp, WithBoard, Running])
                .prop_map(ArmingEvent::Request),
            Just(ArmingEvent::Cancel),
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
    fn nothing_but_a_request_leads_from_safe_to_armed() {
        let without_request = [
            ArmingEvent::Fault,
            ArmingEvent::GoodTransfer,
            ArmingEvent::Cancel,
            ArmingEvent::SetUp,
        ];
        for event in without_request {
            assert_eq!(Arming::Safe.after(event), Arming::Safe, "{event:?}");
        }
    }
}
