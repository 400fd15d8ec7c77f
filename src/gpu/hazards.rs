//! Which commands must wait for those before them, by the buffers that they touch.

use std::collections::HashSet;

/// Buffers that a command reads and writes, by name.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Accesses {
    pub reads: Vec<&'static str>,
    pub writes: Vec<&'static str>,
}

/// Buffers touched since the last barrier.
#[derive(Default)]
pub(super) struct Hazards {
    read: HashSet<&'static str>,
    written: HashSet<&'static str>,
}

impl Hazards {
    /// Notes a command, and says whether a barrier must come before it: it touches what was written since the last
    /// barrier, or writes what was read.
    pub fn needs_barrier(&mut self, accesses: &Accesses) -> bool {
        let Accesses { reads, writes } = accesses;
        let after_write = reads.iter().chain(writes).any(|name| self.written.contains(name));
        let after_read = writes.iter().any(|name| self.read.contains(name));
        let hazard = after_write || after_read;
        if hazard {
            self.read.clear();
            self.written.clear();
        }
        self.read.extend(reads);
        self.written.extend(writes);
        hazard
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_wait_for_what_they_share() {
        let mut hazards = Hazards::default();
        let mut command = |reads: &[&'static str], writes: &[&'static str]| {
            hazards.needs_barrier(&Accesses { reads: reads.to_vec(), writes: writes.to_vec() })
        };
        assert!(!command(&["scene"], &["hits"]));
        assert!(!command(&["scene"], &["film"]), "readers of one buffer do not wait for each other");
        assert!(command(&["hits"], &["paths"]), "a read waits for a write");
        assert!(!command(&["scene"], &["film"]), "a barrier clears what came before it");
        assert!(command(&["scene"], &["hits"]), "a write waits for a read");
        assert!(command(&["scene"], &["hits"]), "a write waits for a write");
    }
}
