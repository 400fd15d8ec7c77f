//! Which classes of rays are traced by packets.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::rays::RayClass;

/// Rays that wide trees are walked for by packets: the rays of a subgroup visit every node that one of them
/// meets, so that none waits for another. Good for rays that are alike.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Packets {
    /// Rays from the camera.
    pub camera: bool,
    /// Rays from a scattering.
    pub bounce: bool,
    /// Rays to a light that are traced from a queue.
    pub shadow: bool,
}

impl Packets {
    /// What their text can be, as advice to someone who wrote another.
    pub const ALLOWED: &str = "use none, or camera, bounce and shadow with + between them";

    /// Whether rays of a class are in packets.
    pub fn has(self, class: RayClass) -> bool {
        match class {
            RayClass::Camera => self.camera,
            RayClass::Bounce => self.bounce,
            RayClass::Shadow => self.shadow,
        }
    }

    /// The same with a class in packets or not.
    pub fn with(mut self, class: RayClass, is: bool) -> Self {
        match class {
            RayClass::Camera => self.camera = is,
            RayClass::Bounce => self.bounce = is,
            RayClass::Shadow => self.shadow = is,
        }
        self
    }
}

const CLASSES: [RayClass; 3] = [RayClass::Camera, RayClass::Bounce, RayClass::Shadow];

/// Classes of rays with a plus between them, or `none`.
impl fmt::Display for Packets {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let classes: Vec<_> = CLASSES.iter().filter(|class| self.has(**class)).map(|class| class.name()).collect();
        f.write_str(if classes.is_empty() { "none".to_owned() } else { classes.join("+") }.as_str())
    }
}

impl FromStr for Packets {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "none" {
            return Ok(Self::default());
        }
        text.split('+').try_fold(Self::default(), |packets, name| {
            let class = CLASSES.iter().find(|class| class.name() == name);
            let class = class.ok_or(Self::ALLOWED)?;
            Ok(packets.with(*class, true))
        })
    }
}
