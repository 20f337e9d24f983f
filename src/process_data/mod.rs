//! Process data: descriptor to packing plan, interface-register bits to engineering values.
