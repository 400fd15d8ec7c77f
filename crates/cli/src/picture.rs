//! What picture to make and on which device: the arguments that commands which render share.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};

use super::{LoadArguments, open_device};
use raywave::gpu::Device;
use raywave::scene::Scene;
use raywave::settings::{Name, Named, Quality, SETTINGS, Setting, Settings, Value, Values};

/// Arguments that say what a pixel is and how it is made, in place of what the scene says.
#[derive(Debug, Clone, Args)]
pub struct PictureArguments {
    #[command(flatten)]
    given: GivenSettings,
    /// How the scene is loaded.
    #[command(flatten)]
    pub load: LoadArguments,
    /// Settings from a measured front of error against time, where the command line does not say
    #[arg(long, value_name = "NAME", value_parser = one_of::<Quality>())]
    quality: Option<Quality>,
    /// Whether what `raywave tune` has found fastest stands in for --bvh, --fetch, --packets and --workgroup where they are not given
    #[arg(long, default_value = "on")]
    tuned: Switch,
    /// Device, by number or part of its name; see `raywave devices`
    #[arg(long, env = "RAYWAVE_DEVICE")]
    device: Option<String>,
}

/// Whether a thing is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Switch {
    /// It is not
    Off,
    /// It is
    On,
}

/// The settings that the command line gives a value, each with its text.
#[derive(Debug, Clone, Default)]
struct GivenSettings(Vec<(&'static Setting, String)>);

impl Args for GivenSettings {
    fn augment_args(command: Command) -> Command {
        SETTINGS.iter().fold(command, |command, setting| command.arg(argument(setting)))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for GivenSettings {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let given = |setting: &'static Setting| {
            if is_bare(setting) {
                return matches.get_flag(setting.flag).then(|| (setting, Value::Switch(true).to_string()));
            }
            Some((setting, matches.get_one::<String>(setting.flag)?.clone()))
        };
        Ok(Self(SETTINGS.iter().filter_map(given).collect()))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// Whether the flag stands alone: it switches on what is off without it.
fn is_bare(setting: &Setting) -> bool {
    (setting.get)(&Settings::default()) == Value::Switch(false)
}

/// The argument of the command line that gives a setting its value.
fn argument(setting: &'static Setting) -> Arg {
    let argument = Arg::new(setting.flag).long(setting.flag).help(setting.help);
    if is_bare(setting) {
        return argument.action(ArgAction::SetTrue);
    }
    let check = move |text: &str| setting.set(&mut Settings::default(), text).map(|()| text.to_owned());
    let argument = argument.value_name(setting.placeholder).allow_negative_numbers(true);
    match setting.values {
        Values::Names(names) => argument.value_parser(possible_values(&names())),
        Values::Switch => argument.value_parser(PossibleValuesParser::new(setting.names())),
        _ => argument.value_parser(check),
    }
}

fn possible_values(names: &[Name]) -> PossibleValuesParser {
    PossibleValuesParser::new(names.iter().map(|name| PossibleValue::new(name.name).help(name.meaning.clone())))
}

/// Reads one of an enum's names.
pub fn one_of<T: Named + std::str::FromStr<Err = strum::ParseError> + Send + Sync + 'static>()
-> impl TypedValueParser<Value = T> {
    possible_values(&T::names()).try_map(|name| name.parse::<T>())
}

impl PictureArguments {
    /// The scene's settings, with what the command line says instead.
    ///
    /// # Errors
    /// Settings that make no sense together.
    pub fn settings(&self, scene: &Scene) -> anyhow::Result<Settings> {
        let mut settings = scene.settings;
        if let Some(quality) = self.quality {
            settings = quality.of(settings);
        }
        for (setting, text) in &self.given.0 {
            setting.set(&mut settings, text).map_err(|problem| anyhow::anyhow!("--{}: {problem}", setting.flag))?;
        }
        settings.validate()?;
        Ok(settings)
    }

    /// Whether the command line says how many samples there are.
    pub fn has_samples(&self) -> bool {
        self.quality.is_some() || self.given.0.iter().any(|(setting, _)| setting.flag == "samples")
    }

    /// Opens the device that is wanted, or the best one.
    ///
    /// # Errors
    /// No Vulkan, no such device.
    pub fn open_device(&self) -> anyhow::Result<Device> {
        open_device(self.device())
    }

    /// Whether tunings are wanted.
    pub fn tuned(&self) -> bool {
        self.tuned == Switch::On
    }

    /// The device that is wanted, by number or part of its name.
    pub fn device(&self) -> Option<&str> {
        self.device.as_deref()
    }
}
