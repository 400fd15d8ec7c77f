//! The one list of settings: what each is called, takes, means and does to the image.
//!
//! Flags of the command line, factors of `compare`, knobs of `tradeoff`, records in metadata and JSON, and the README's
//! table all follow from [`SETTINGS`]. A new setting is a field of [`Settings`], an entry here, and the code that heeds it.

use std::fmt;
use std::str::FromStr;

use serde_json::Map;

use super::{
    Fetch, Filter, Instances, Integrator, MAX_MATERIAL_BRANCHES, MAX_SAMPLES, Name, Named, Numerics, Offsets, Packets,
    PathState, RouletteMode, Sampler, Scheduler, Settings, ShadowRays, Sort,
};
use crate::bvh::BvhKind;

/// What another value of a setting does to the image, and so what may be compared with what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// How the work is done. The image stays the same to the last bit.
    Schedule,
    /// How the image is estimated or rounded. It stays the same up to noise.
    Estimator,
    /// What there is to do. Another value is another image; only renders of one value are compared.
    Workload,
}

/// The values that a setting takes.
#[derive(Debug, Clone, Copy)]
pub enum Values {
    /// These names.
    Names(fn() -> Vec<Name>),
    /// Off or on.
    Switch,
    /// A count.
    Count {
        /// The least.
        least: u32,
    },
    /// A number from 0 up to, not including, 1.
    Probability,
    /// A number above 0, or `off`.
    PositiveOrOff,
    /// `none`, or `camera`, `bounce` and `shadow` with `+` between them.
    RayClasses,
}

/// The value of a setting. Its text is what a flag takes.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// Left to scene, device and tuning.
    Auto,
    /// A bound that there is not.
    Off,
    /// No bound on a count.
    Unbounded,
    /// A count.
    Count(u32),
    /// A number.
    Number(f64),
    /// A name.
    Name(&'static str),
    /// Classes of rays.
    RayClasses(String),
    /// Whether something is done.
    Switch(bool),
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Off => f.write_str("off"),
            Self::Unbounded => f.write_str("-1"),
            Self::Count(count) => count.fmt(f),
            Self::Number(number) => number.fmt(f),
            Self::Name(name) => f.write_str(name),
            Self::RayClasses(classes) => f.write_str(classes),
            Self::Switch(on) => f.write_str(if *on { "on" } else { "off" }),
        }
    }
}

impl From<Value> for serde_json::Value {
    fn from(value: Value) -> Self {
        match value {
            Value::Auto | Value::Off => Self::Null,
            Value::Unbounded => (-1).into(),
            Value::Count(count) => count.into(),
            Value::Number(number) => number.into(),
            Value::Name(name) => name.into(),
            Value::RayClasses(classes) => classes.into(),
            Value::Switch(on) => on.into(),
        }
    }
}

/// How `raywave tradeoff` turns a setting that buys speed with error, or looks as if it might.
#[derive(Debug, Clone, Copy)]
pub struct Knob {
    /// The value that a reference is rendered with: an exact one, and of several the surest. `None` leaves the base's.
    pub exact: Option<&'static str>,
    /// Values to try over a base whose image has this mean radiance; the base's own is left out afterwards.
    pub values: fn(base: &Settings, mean_radiance: f64) -> Vec<String>,
}

/// A setting, for everything that goes over all of them.
#[derive(Debug, Clone, Copy)]
pub struct Setting {
    /// The flag of the command line without its dashes, and the name of the factor in studies.
    pub flag: &'static str,
    /// The key in records: snake_case, with the unit.
    pub key: &'static str,
    /// What stands for its value in help.
    pub placeholder: &'static str,
    /// What it is, for help: a sentence without its full stop, which the names' own meanings may follow.
    pub help: &'static str,
    /// What is more to say where there is room, for the README; empty where nothing is.
    pub more: &'static str,
    /// What is taken where nobody says, in words; empty where [`Settings::default`] says it all.
    pub otherwise: &'static str,
    /// What it is in a few words, for axes and tables.
    pub meaning: &'static str,
    /// Its values.
    pub values: Values,
    /// Whether a scene file may set it.
    pub of_scene: bool,
    /// What it does to the image.
    pub role: Role,
    /// How these settings bias the image by this one, if they do.
    pub bias: fn(&Settings) -> Option<String>,
    /// The values that a study gives it where the user names none; none where studies do not vary it.
    pub levels: &'static [&'static str],
    /// How a sweep turns it, if one does.
    pub knob: Option<Knob>,
    /// Its value.
    pub get: fn(&Settings) -> Value,
    set: fn(&mut Settings, &str) -> Result<(), String>,
}

impl PartialEq for Setting {
    /// Flags tell settings apart.
    fn eq(&self, other: &Self) -> bool {
        self.flag == other.flag
    }
}

impl Setting {
    /// The setting of that flag.
    pub fn of(flag: &str) -> Option<&'static Self> {
        SETTINGS.iter().find(|setting| setting.flag == flag)
    }

    /// Those that a study can vary.
    pub fn factors() -> impl Iterator<Item = &'static Self> {
        SETTINGS.iter().filter(|setting| !setting.levels.is_empty())
    }

    /// Gives it a value, as text that a flag takes. Counts may end in k (1024) or M (1024²).
    ///
    /// # Errors
    /// Says why the text is no value of it.
    pub fn set(&self, settings: &mut Settings, text: &str) -> Result<(), String> {
        (self.set)(settings, text)
    }

    /// Says which values it takes, as advice to someone who gave another.
    pub fn allowed(&self) -> String {
        match self.values {
            Values::Names(_) | Values::Switch => format!("use {}", self.names().join(" or ")),
            Values::Count { least } => {
                format!("use a count from {least} on, such as 64 or 16k (k is 1024, M is 1024²)")
            }
            Values::Probability => "use a number from 0 up to, not including, 1".to_owned(),
            Values::PositiveOrOff => "use a number above 0, or off".to_owned(),
            Values::RayClasses => Packets::ALLOWED.to_owned(),
        }
    }

    /// The names that it takes; none where its values have no names.
    pub fn names(&self) -> Vec<&'static str> {
        match self.values {
            Values::Names(names) => names().into_iter().map(|name| name.name).collect(),
            Values::Switch => vec!["off", "on"],
            _ => Vec::new(),
        }
    }

    /// Whether two texts are one value of it, as 64k and 65536 are.
    pub fn same(&self, a: &str, b: &str) -> bool {
        let value = |text: &str| {
            let mut settings = Settings::default();
            self.set(&mut settings, text).ok().map(|()| (self.get)(&settings))
        };
        a == b || value(a).is_some_and(|a| value(b) == Some(a))
    }
}

/// A count as people write it: digits and perhaps a suffix, k for 1024 and M for 1024². Queues and
/// workgroups are sized in powers of two, so 64k is 65,536 here, not 64,000.
pub fn parse_count(text: &str) -> Option<u64> {
    let (digits, unit) = match text.as_bytes().last()? {
        b'k' | b'K' => (&text[..text.len() - 1], 1 << 10),
        b'M' | b'm' => (&text[..text.len() - 1], 1 << 20),
        _ => (text, 1),
    };
    // `parse` would take a plus sign.
    let plain = digits.bytes().all(|byte| byte.is_ascii_digit());
    digits.parse::<u64>().ok().filter(|_| plain)?.checked_mul(unit)
}

/// The flags of `raywave render` that make these settings of any scene: each that is not as it is without a flag, and
/// each that a scene file may set.
pub fn flags(settings: &Settings) -> String {
    let otherwise = Settings::default();
    let flag = |setting: &Setting| {
        let value = (setting.get)(settings);
        let differs = value != (setting.get)(&otherwise);
        match (setting.values, value) {
            _ if !differs && !setting.of_scene => None,
            (Values::Switch, Value::Switch(true)) if !matches!((setting.get)(&otherwise), Value::Switch(true)) => {
                Some(format!("--{}", setting.flag))
            }
            (_, value) => Some(format!("--{} {value}", setting.flag)),
        }
    };
    SETTINGS.iter().filter_map(flag).collect::<Vec<_>>().join(" ")
}

/// Every setting by its key.
pub fn record(settings: &Settings) -> Map<String, serde_json::Value> {
    SETTINGS.iter().map(|setting| (setting.key.to_owned(), (setting.get)(settings).into())).collect()
}

fn named<T: FromStr>(text: &str) -> Result<T, String> {
    text.parse().map_err(|_| format!("{text} is none of the names"))
}

fn switch(text: &str) -> Result<bool, String> {
    match text {
        "off" => Ok(false),
        "on" => Ok(true),
        _ => Err(format!("{text} is neither off nor on")),
    }
}

fn number(text: &str) -> Result<f64, String> {
    text.parse().map_err(|_| format!("{text} is not a number"))
}

/// A count in a range whose least is -1 where there need be no bound.
fn integer(text: &str, least: i64, most: u32) -> Result<i64, String> {
    let magnitude = parse_count(text.trim_start_matches('-')).and_then(|count| i64::try_from(count).ok());
    let magnitude =
        magnitude.ok_or("invalid digit found in it; use a count such as 64 or 16k (k is 1024, M is 1024²)")?;
    let count = if text.starts_with('-') { -magnitude } else { magnitude };
    let fits = (least..=i64::from(most)).contains(&count);
    fits.then_some(count).ok_or_else(|| format!("{count} is not in {least}..={most}"))
}

/// Reads a count for a setting that takes counts in this range.
fn count(text: &str, least: u32, most: u32) -> Result<u32, String> {
    integer(text, i64::from(least), most).map(|count| count as u32)
}

/// All that entries leave out.
const PLAIN: Setting = Setting {
    flag: "",
    key: "",
    placeholder: "N",
    help: "",
    more: "",
    otherwise: "",
    meaning: "",
    values: Values::Switch,
    of_scene: false,
    role: Role::Schedule,
    bias: |_| None,
    levels: &[],
    knob: None,
    get: |_| Value::Auto,
    set: |_, _| Ok(()),
};

/// An entry for a choice among the names of an enum.
macro_rules! chosen {
    ($field:ident: $type:ty, $($key:ident: $value:expr),* $(,)?) => {
        Setting {
            $($key: $value,)*
            ..Setting {
                placeholder: "NAME",
                values: Values::Names(<$type as Named>::names),
                get: |settings| Value::Name(settings.$field.name()),
                set: |settings, text| named(text).map(|choice| settings.$field = choice),
                ..PLAIN
            }
        }
    };
}

/// An entry for such a choice that can be left to the device.
macro_rules! chosen_or_auto {
    ($field:ident: $type:ty, $($key:ident: $value:expr),* $(,)?) => {
        Setting {
            $($key: $value,)*
            ..Setting {
                placeholder: "NAME",
                values: Values::Names(<$type as Named>::names),
                get: |settings| settings.$field.map_or(Value::Auto, |choice| Value::Name(choice.name())),
                set: |settings, text| named(text).map(|choice| settings.$field = Some(choice)),
                ..PLAIN
            }
        }
    };
}

/// An entry for a count.
macro_rules! counted {
    ($field:ident in $least:literal..=$most:expr, $($key:ident: $value:expr),* $(,)?) => {
        Setting {
            $($key: $value,)*
            ..Setting {
                values: Values::Count { least: $least },
                get: |settings| Value::Count(settings.$field),
                set: |settings, text| count(text, $least, $most).map(|count| settings.$field = count),
                ..PLAIN
            }
        }
    };
}

/// An entry for a count that can be left to the device.
macro_rules! counted_or_auto {
    ($field:ident in $least:literal..=$most:expr, $($key:ident: $value:expr),* $(,)?) => {
        Setting {
            $($key: $value,)*
            ..Setting {
                values: Values::Count { least: $least },
                get: |settings| settings.$field.map_or(Value::Auto, Value::Count),
                set: |settings, text| count(text, $least, $most).map(|count| settings.$field = Some(count)),
                ..PLAIN
            }
        }
    };
}

/// All names of a choice, for a knob.
fn every<T: Named>() -> Vec<String> {
    T::names().into_iter().map(|name| name.name.to_owned()).collect()
}

/// A number above 0 to two digits.
fn two_digits(value: f64) -> String {
    format!("{value:.1e}").parse().map_or_else(|_| "1".to_owned(), |rounded: f64| rounded.to_string())
}

/// Every setting, those of a scene's look first. `tradeoff` turns knobs in this order.
pub static SETTINGS: &[Setting] = &[
    counted! {
        width in 1..=65_536,
        flag: "width", key: "width_pixels", placeholder: "WIDTH", help: "Image width in pixels", of_scene: true, role: Role::Workload,
    },
    counted! {
        height in 1..=65_536,
        flag: "height", key: "height_pixels", placeholder: "HEIGHT", help: "Image height in pixels", of_scene: true, role: Role::Workload,
    },
    counted! {
        samples in 1..=u32::MAX,
        flag: "samples",
        key: "samples_per_pixel",
        placeholder: "SAMPLES",
        help: "Samples per pixel",
        more: "up to 2^24",
        meaning: "samples per pixel",
        of_scene: true,
        role: Role::Workload,
        levels: &["4", "16", "64"],
    },
    counted_or_auto! {
        block_samples in 1..=MAX_SAMPLES,
        flag: "block-samples",
        key: "block_samples",
        placeholder: "SAMPLES",
        help: "Samples of a block, a power of two: the parts that a render can be cut into; it changes rounding alone",
        otherwise: "256; below 64x64 pixels, as many as make 2^20 samples, up to 16,384",
        meaning: "samples of a block, whose sum is rounded by itself",
        role: Role::Estimator,
    },
    Setting {
        flag: "halves",
        key: "halves",
        help: "Take samples in two halves that are scrambled independently, whose difference tells the error",
        more: "`--target-error` takes them so; a Sobol sequence is worth more undivided",
        meaning: "samples in two halves",
        role: Role::Estimator,
        get: |settings| Value::Switch(settings.halves),
        set: |settings, text| switch(text).map(|on| settings.halves = on),
        ..PLAIN
    },
    chosen! {
        integrator: Integrator,
        flag: "integrator",
        key: "integrator",
        help: "How light is gathered",
        meaning: "integrator",
        of_scene: true,
        role: Role::Estimator,
        levels: &["explicit", "implicit", "mis"],
        knob: Some(Knob { exact: Some("mis"), values: |_, _| every::<Integrator>() }),
    },
    chosen! {
        sampler: Sampler,
        flag: "sampler",
        key: "sampler",
        help: "Where random numbers come from",
        meaning: "source of random numbers",
        of_scene: true,
        role: Role::Estimator,
        levels: &["independent", "sobol"],
        knob: Some(Knob { exact: Some("independent"), values: |_, _| every::<Sampler>() }),
    },
    Setting {
        flag: "max-bounces",
        key: "max_bounces",
        help: "Scattering events between camera and light; -1 is unbounded and needs Russian roulette",
        meaning: "bounces of a path",
        values: Values::Count { least: 0 },
        of_scene: true,
        role: Role::Workload,
        levels: &["2", "4", "8", "16"],
        knob: Some(Knob {
            exact: None,
            // More bounces than the image has would be another image.
            values: |base, _| {
                let fewer = |bounces: &u32| base.max_bounces.is_none_or(|most| *bounces < most);
                [1, 2, 3, 4, 8, 16].into_iter().filter(fewer).map(|bounces| bounces.to_string()).collect()
            },
        }),
        get: |settings| settings.max_bounces.map_or(Value::Unbounded, Value::Count),
        set: |settings, text| {
            integer(text, -1, 1_000_000).map(|bounces| settings.max_bounces = u32::try_from(bounces).ok())
        },
        ..PLAIN
    },
    Setting {
        flag: "roulette",
        key: "roulette",
        placeholder: "Q",
        help: "Russian roulette: probability of stopping at each vertex, in [0, 1)",
        meaning: "probability of stopping at a vertex",
        values: Values::Probability,
        of_scene: true,
        role: Role::Estimator,
        levels: &["0", "0.1", "0.2", "0.4"],
        knob: Some(Knob {
            exact: None,
            values: |base, _| {
                let least = if base.max_bounces.is_none() { 0.05 } else { 0.0 };
                [least, 0.1, 0.2, 0.4].map(|q: f64| q.to_string()).to_vec()
            },
        }),
        get: |settings| Value::Number(settings.roulette),
        set: |settings, text| number(text).map(|q| settings.roulette = q),
        ..PLAIN
    },
    chosen! {
        roulette_mode: RouletteMode,
        flag: "roulette-mode",
        key: "roulette_mode",
        help: "How Russian roulette decides; the image stays the same up to noise",
        meaning: "how a roulette decides",
        role: Role::Estimator,
        levels: &["constant", "throughput"],
        knob: Some(Knob { exact: None, values: |_, _| every::<RouletteMode>() }),
    },
    counted! {
        roulette_from in 0..=u32::MAX,
        flag: "roulette-from",
        key: "roulette_from_vertex",
        placeholder: "VERTEX",
        help: "First vertex at which Russian roulette by throughput may stop a path; 0 is what the camera sees",
        meaning: "first vertex of a roulette by throughput",
        role: Role::Estimator,
        levels: &["0", "1", "3", "5"],
    },
    Setting {
        flag: "clamp",
        key: "clamp_radiance",
        placeholder: "RADIANCE",
        help: "Most radiance, in any channel, that indirect light may bring to a sample by one vertex; BIASED: the image \
               loses light",
        more: "indirect light is that of two bounces and more; fireflies go, and energy with them",
        otherwise: "off",
        meaning: "most radiance of indirect light",
        values: Values::PositiveOrOff,
        role: Role::Workload,
        bias: |settings| settings.clamp.map(|clamp| format!("indirect light is clamped at a radiance of {clamp}")),
        levels: &["off", "10", "1"],
        knob: Some(Knob {
            exact: Some("off"),
            values: |_, mean| [2.0, 8.0, 32.0].map(|times| two_digits(times * mean)).to_vec(),
        }),
        get: |settings| settings.clamp.map_or(Value::Off, Value::Number),
        set: |settings, text| {
            settings.clamp = if text == "off" { None } else { Some(number(text)?) };
            Ok(())
        },
        ..PLAIN
    },
    counted! {
        seed in 0..=u32::MAX,
        flag: "seed", key: "seed", placeholder: "SEED", help: "Seed of the random numbers", role: Role::Estimator,
    },
    chosen! {
        filter: Filter,
        flag: "filter",
        key: "filter",
        help: "How the light about a pixel makes its value",
        meaning: "the filter of pixels",
        role: Role::Workload,
        levels: &["box", "gaussian"],
    },
    chosen! {
        path_state: PathState,
        flag: "path-state",
        key: "path_state",
        help: "How exactly the state of a path is kept between its vertices",
        meaning: "how exactly path state is kept",
        role: Role::Estimator,
        levels: &["f32", "f16"],
        knob: Some(Knob { exact: Some("f32"), values: |_, _| every::<PathState>() }),
    },
    chosen! {
        offsets: Offsets,
        flag: "offsets",
        key: "offsets",
        help: "How rays are kept from hitting the surface that they leave",
        meaning: "how rays leave surfaces",
        role: Role::Estimator,
        bias: |settings| match settings.offsets {
            Offsets::Robust => None,
            Offsets::Unchecked => {
                Some("rays that leave thin triangles at a convex edge may hit the neighbour behind them".to_owned())
            }
            Offsets::Fixed => Some("surfaces closer to each other than 1e-4 of the scene are not told apart".to_owned()),
        },
        levels: &["robust", "unchecked", "fixed"],
        knob: Some(Knob { exact: Some("robust"), values: |_, _| every::<Offsets>() }),
    },
    chosen! {
        numerics: Numerics,
        flag: "numerics",
        key: "numerics",
        help: "Who defines quotients, roots and vector products where Vulkan leaves them to the driver",
        more: "see [docs/numerics.md](docs/numerics.md)",
        meaning: "who lays down quotients, roots and vector products",
        role: Role::Estimator,
        levels: &["portable", "native"],
    },
    Setting {
        flag: "fast-math",
        key: "fast_math",
        help: "Let the driver fuse and reorder arithmetic: images are no longer equal to the last bit",
        meaning: "fused and reordered arithmetic",
        role: Role::Estimator,
        levels: &["off", "on"],
        knob: Some(Knob { exact: Some("off"), values: |_, _| vec!["off".to_owned(), "on".to_owned()] }),
        get: |settings| Value::Switch(settings.fast_math),
        set: |settings, text| switch(text).map(|on| settings.fast_math = on),
        ..PLAIN
    },
    chosen_or_auto! {
        scheduler: Scheduler,
        flag: "scheduler",
        key: "scheduler",
        help: "How the work is cut into kernels; the image is the same to the last bit",
        otherwise: "`bounce` on GPUs. On software of eight lanes a subgroup `megakernel`, for scenes that are a list of \
                    triangles, for others from 524,288 samples on; where the driver limits loops, up to 255 bounces, and \
                    as long as paths are so short that an invocation can follow 16; else `bounce`. `wavefront` on \
                    software of fewer lanes, and with `--sort`",
        meaning: "scheduler",
        levels: &["wavefront", "bounce", "megakernel"],
    },
    chosen_or_auto! {
        bvh: BvhKind,
        flag: "bvh",
        key: "bvh",
        help: "Shape of the BVH; it changes speed and memory, not the image",
        otherwise: "`list` where it fits, else `bvh2` on GPUs and `cwbvh` on software; `bvh2` on software of fewer than \
                    eight lanes a subgroup",
        meaning: "shape of the BVH",
        levels: &["bvh2", "bvh4", "cwbvh"],
        knob: Some(Knob { exact: None, values: |_, _| ["bvh2", "bvh4", "cwbvh"].map(str::to_owned).to_vec() }),
    },
    chosen_or_auto! {
        instances: Instances,
        flag: "instances",
        key: "instances",
        help: "How meshes lie in memory that are placed more than once; it changes speed and memory, not the image",
        otherwise: "`two-level` where the triangles of all placements would take more than 256 MiB, and more than four \
                    times what they take in two levels, or where one tree cannot address them, unless `--bvh` is another \
                    than `bvh2`; else `flatten`",
        meaning: "how placed meshes lie in memory",
        levels: &["flatten", "two-level"],
    },
    chosen_or_auto! {
        fetch: Fetch,
        flag: "fetch",
        key: "scene_fetch",
        help: "How kernels read the scene's buffers; it changes speed, not the image",
        otherwise: "on software the one that [was measured](#what-is-measured-of-a-device) as faster, `storage` on GPUs",
        meaning: "how kernels read the scene",
        levels: &["texel", "storage"],
    },
    Setting {
        flag: "packets",
        key: "packets",
        placeholder: "CLASSES",
        help: "Rays of queues that subgroups trace together, in trees of four or eight children a node: none, or camera, \
               bounce and shadow with + between them; it changes speed, not the image",
        otherwise: "what `tune` has found, else `none`",
        meaning: "rays traced by packets",
        values: Values::RayClasses,
        levels: &["none", "camera"],
        get: |settings| settings.packets.map_or(Value::Auto, |packets| Value::RayClasses(packets.to_string())),
        set: |settings, text| text.parse().map(|packets| settings.packets = Some(packets)),
        ..PLAIN
    },
    chosen! {
        sort: Sort,
        flag: "sort",
        key: "sort",
        help: "Order in which the wavefront shades; it changes speed, not the image",
        more: "without `--scheduler`, sorting takes the wavefront",
        meaning: "order of shading",
        role: Role::Schedule,
        levels: &["none", "material"],
    },
    chosen! {
        shadow_rays: ShadowRays,
        flag: "shadow-rays",
        key: "shadow_rays",
        help: "When the bounce scheduler traces shadow rays; it changes speed and memory, not the image",
        meaning: "when the bounce scheduler traces shadow rays",
        role: Role::Schedule,
        levels: &["deferred", "at-once"],
    },
    counted_or_auto! {
        in_flight in 1..=u32::MAX,
        flag: "in-flight",
        key: "paths_in_flight",
        placeholder: "PATHS",
        help: "Paths in flight; it changes speed and memory, not the image",
        otherwise: "8,388,608 on GPUs, as far as a quarter of their memory allows; on software 262,144, and 1,048,576 \
                    (4,194,304 in a list) for the megakernel",
        meaning: "paths in flight",
        levels: &["16k", "64k", "256k", "1M"],
    },
    counted_or_auto! {
        workgroup_size in 1..=1024,
        flag: "workgroup",
        key: "workgroup_size_invocations",
        placeholder: "SIZE",
        help: "Invocations of a workgroup",
        otherwise: "256",
        meaning: "invocations of a workgroup",
        levels: &["32", "64", "128", "256"],
    },
    counted_or_auto! {
        paths_per_invocation in 1..=65_536,
        flag: "paths-per-invocation",
        key: "paths_per_invocation",
        placeholder: "PATHS",
        help: "Paths that an invocation of the megakernel follows one after the other; above 1 no path waits for its \
               subgroup's longest",
        otherwise: "on software as many as leave 16,384 invocations and stay within the loops that its driver runs; 1 on \
                    GPUs",
        meaning: "paths of a megakernel's invocation",
        levels: &["1", "8", "32"],
    },
    Setting {
        flag: "specialize",
        key: "specialize",
        help: "Whether kernels and buffers are made for what the scene needs, or for any scene; the image is the same",
        meaning: "kernels and buffers for this scene alone",
        levels: &["off", "on"],
        get: |settings| Value::Switch(settings.specialize),
        set: |settings, text| switch(text).map(|on| settings.specialize = on),
        ..PLAIN
    },
    counted! {
        shading_cost in 0..=32_768,
        flag: "shading-cost",
        key: "shading_cost_steps",
        placeholder: "STEPS",
        help: "Dependent steps of arithmetic added to the shading of each hit, to stand for costlier materials; they \
               change speed, not the image",
        meaning: "added shading steps per hit",
        role: Role::Workload,
        levels: &["0", "64", "256", "1k", "4k"],
    },
    counted! {
        material_branches in 1..=MAX_MATERIAL_BRANCHES,
        flag: "materials",
        key: "material_branches",
        placeholder: "BRANCHES",
        help: "Branches that the scattering of hits is spread over by triangle, as if the scene had that many BSDFs; they \
               change speed, not the image",
        meaning: "branches of scattering",
        role: Role::Workload,
        levels: &["1", "2", "4", "8", "16"],
    },
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_is_read_back_from_its_text() {
        for setting in SETTINGS {
            let value = |text: &str| {
                let mut settings = Settings::default();
                setting.set(&mut settings, text).unwrap_or_else(|error| panic!("{}={text}: {error}", setting.flag));
                (setting.get)(&settings)
            };
            let texts = setting.levels.iter().copied().chain(setting.names());
            for text in texts {
                let first = value(text);
                assert_ne!(first, Value::Auto, "{}={text}", setting.flag);
                assert_eq!(value(&first.to_string()), first, "{}={text}", setting.flag);
            }
            let mut settings = Settings::default();
            assert!(setting.set(&mut settings, "magic").is_err(), "{} takes anything", setting.flag);
            assert_eq!(settings, Settings::default(), "{} is changed by what it refuses", setting.flag);
        }
    }

    #[test]
    fn entries_are_whole_and_tell_themselves_apart() {
        for (i, setting) in SETTINGS.iter().enumerate() {
            assert!(!setting.flag.is_empty() && !setting.key.is_empty() && !setting.help.is_empty(), "{setting:?}");
            let others = SETTINGS[..i].iter().all(|other| other.flag != setting.flag && other.key != setting.key);
            assert!(others, "{} stands twice", setting.flag);
            assert!(
                setting.levels.is_empty() || !setting.meaning.is_empty(),
                "{} has no name for an axis",
                setting.flag
            );
            // A knob's exact value and all that it tries are values of it, and none is tried twice.
            let Some(knob) = setting.knob else { continue };
            let mut values = (knob.values)(&Settings::default(), 0.5);
            values.extend(knob.exact.map(str::to_owned));
            for value in &values {
                let mut settings = Settings::default();
                assert!(setting.set(&mut settings, value).is_ok(), "{}={value}", setting.flag);
                assert!(settings.validate().is_ok(), "{}={value}", setting.flag);
            }
        }
    }

    #[test]
    fn the_record_has_every_field() {
        let record = record(&Settings::default());
        let serde_json::Value::Object(fields) = serde_json::to_value(Settings::default()).expect("JSON") else {
            panic!("settings are an object")
        };
        assert_eq!(record.len(), fields.len());
        assert_eq!(record["max_bounces"], 8);
        let unbounded = Settings { max_bounces: None, ..Settings::default() };
        assert_eq!(super::record(&unbounded)["max_bounces"], -1);
    }

    #[test]
    fn flags_are_what_differs_and_what_a_scene_may_set() {
        let of_scene = "--width 512 --height 512 --samples 64 --integrator explicit --sampler sobol --max-bounces 8 \
                        --roulette 0";
        assert_eq!(flags(&Settings::default()), of_scene);
        let settings = Settings {
            roulette_from: 0,
            clamp: Some(2.5),
            fast_math: true,
            bvh: Some(BvhKind::Bvh4),
            specialize: false,
            ..Settings::default()
        };
        let more = "--roulette-from 0 --clamp 2.5 --fast-math --bvh bvh4 --specialize off";
        assert_eq!(flags(&settings), format!("{of_scene} {more}"));
    }

    #[test]
    fn counts_have_suffixes_and_bounds() {
        assert_eq!(
            ["64", "64k", "2M", "+1", "-1", "k", ""].map(parse_count),
            [Some(64), Some(65_536), Some(2_097_152), None, None, None, None]
        );
        let bounces = Setting::of("max-bounces").expect("it is a setting");
        let mut settings = Settings::default();
        assert_eq!(bounces.set(&mut settings, "-2"), Err("-2 is not in -1..=1000000".to_owned()));
        assert_eq!(bounces.set(&mut settings, "-1"), Ok(()));
        assert_eq!(settings.max_bounces, None);
        assert!(bounces.same("2k", "2048") && !bounces.same("2k", "2000"));
    }
}
