//! A small random generator, so that a seed determines a whole run.

/// The state; its first value is the seed.
#[derive(Debug)]
pub struct Chance(pub u64);

impl Chance {
    /// 31 random bits.
    fn next(&mut self) -> u64 {
        // Knuth's multiplier; the high half is good enough here.
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        self.0 >> 33
    }

    /// A number from 0 up to, but excluding, `end`.
    pub fn below(&mut self, end: u64) -> u64 {
        self.next() % end
    }

    /// A random word of a register.
    pub fn word(&mut self) -> u32 {
        (self.next() << 16 ^ self.next()) as u32
    }

    /// True once in `n` times on average.
    pub fn one_in(&mut self, n: u64) -> bool {
        self.below(n) == 0
    }

    /// A random element of `all`.
    pub fn of<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len() as u64) as usize]
    }
}
