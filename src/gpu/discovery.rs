//! Why there is no device, or not the one that was hoped for: what the Vulkan loader looks at, looked at the same way.
//!
//! The loader says only that there is no driver. The search is that of its document LoaderDriverInterface.md, on Linux: the
//! files that environment variables name or, without, those in the folders of the XDG base directories; filters on their
//! names; the library that each file names; the nodes that a driver then opens.

use std::env;
use std::fmt;
use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use super::{GpuError, Instance};

/// What was looked at, and what it means.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// How it stands.
    pub verdict: Verdict,
    /// What was found, and what to do where that is not well.
    pub text: String,
}

/// How a finding stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// All is well with it.
    Fine,
    /// It may surprise, and keeps no driver from working.
    Note,
    /// A driver or a device is lost by it.
    Problem,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let verdict = match self.verdict {
            Verdict::Fine => "ok",
            Verdict::Note => "note",
            Verdict::Problem => "problem",
        };
        write!(f, "{verdict:<8} {}", self.text)
    }
}

/// What stands between this process and Vulkan devices, from the loader to the devices.
#[derive(Debug, Default)]
pub struct Discovery {
    /// In the order in which they were come upon.
    pub findings: Vec<Finding>,
    /// Whether there is a device that can be used.
    pub has_device: bool,
    /// Whether some driver is of NVIDIA.
    nvidia: bool,
}

impl Discovery {
    /// Looks at everything. Loads the drivers' libraries, as the Vulkan loader does.
    pub fn new() -> Self {
        let mut discovery = Self::default();
        discovery.loader();
        if cfg!(target_os = "linux") {
            discovery.drivers();
            discovery.nodes(Path::new("/"));
            discovery.slices();
        } else {
            discovery.note("drivers and their files are looked at on Linux alone".to_owned());
        }
        discovery.devices();
        discovery
    }

    /// The first problem with drivers, in one line.
    pub(super) fn first_problem() -> Option<String> {
        let mut discovery = Self::default();
        if cfg!(target_os = "linux") {
            discovery.drivers();
        }
        let mut problems = discovery.findings.into_iter().filter(|finding| finding.verdict == Verdict::Problem);
        problems.next().map(|problem| problem.text)
    }

    fn fine(&mut self, text: String) {
        self.findings.push(Finding { verdict: Verdict::Fine, text });
    }

    fn note(&mut self, text: String) {
        self.findings.push(Finding { verdict: Verdict::Note, text });
    }

    fn problem(&mut self, text: String) {
        self.findings.push(Finding { verdict: Verdict::Problem, text });
    }

    fn loader(&mut self) {
        // SAFETY: as where an instance is made; nothing is kept of it.
        match unsafe { ash::Entry::load() } {
            Ok(_) => self.fine("the Vulkan loader is there".to_owned()),
            Err(error) => self.problem(format!(
                "the Vulkan loader is not there ({error}); on Debian or Ubuntu `apt install libvulkan1`"
            )),
        }
    }

    /// The files of drivers, and the libraries that they name.
    fn drivers(&mut self) {
        let files = self.files();
        let mut kept = 0;
        for file in &files {
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if let Some(why) = filtered(&name, variable(SELECT).as_deref(), variable(DISABLE).as_deref()) {
                self.note(format!("{}: {why}", file.display()));
            } else {
                kept += 1;
                self.driver(file);
            }
        }
        if !files.is_empty() && kept == 0 {
            let set = [SELECT, DISABLE].into_iter().filter_map(|name| Some(format!("{name}={}", variable(name)?)));
            let set = set.collect::<Vec<_>>().join(" and ");
            self.problem(format!("{set} leaves out every driver; unset it, or let a driver's file pass"));
        }
    }

    /// The files that the loader would read.
    fn files(&mut self) -> Vec<PathBuf> {
        // These count even if they are empty.
        let set = |name| env::var_os(name).map(|value| value.to_string_lossy().into_owned());
        let named = [FILES, OLD_FILES].into_iter().find_map(|name| Some((name, set(name)?)));
        if let (Some((FILES, _)), Some(_)) = (&named, set(OLD_FILES)) {
            self.note(format!("{OLD_FILES} is ignored, since {FILES} is set"));
        }
        if let Some((name, paths)) = named {
            if variable(ADDED_FILES).is_some() {
                self.note(format!("{ADDED_FILES} is ignored, since {name} is set"));
            }
            if paths.is_empty() {
                self.problem(format!("{name} is set and empty, so no driver is looked for; unset it"));
            }
            return self.named_files(name, &paths);
        }
        let mut files = match variable(ADDED_FILES) {
            Some(paths) => self.named_files(ADDED_FILES, &paths),
            None => Vec::new(),
        };
        let folders = folders();
        let found: Vec<_> = folders.iter().flat_map(|folder| manifests(folder).unwrap_or_default()).collect();
        if found.is_empty() && files.is_empty() {
            let folders: Vec<_> = folders.iter().map(|folder| folder.display().to_string()).collect();
            self.problem(format!(
                "no driver is installed: no .json file is in {}; install one: `apt install mesa-vulkan-drivers` gives lavapipe, \
                 which needs no GPU, or install the driver of your card",
                folders.join(", ")
            ));
        }
        files.extend(found);
        files
    }

    /// Files, and files in folders, that a variable names.
    fn named_files(&mut self, variable: &str, paths: &str) -> Vec<PathBuf> {
        let mut files = Vec::new();
        for path in env::split_paths(paths).filter(|path| !path.as_os_str().is_empty()) {
            let advice = format!("unset {variable}, or name the .json file of a driver");
            match manifests(&path) {
                Ok(found) if found.is_empty() => {
                    self.problem(format!("{variable} names {}, in which no .json file is; {advice}", path.display()));
                }
                Ok(found) => files.extend(found),
                Err(error) if error.kind() == ErrorKind::NotADirectory => files.push(path),
                Err(error) => {
                    let what = why(&error);
                    self.problem(format!("{variable} names {}, {what}; {advice}", path.display()));
                }
            }
        }
        files
    }

    /// A driver, by its file.
    fn driver(&mut self, file: &Path) {
        let shown = file.display();
        let text = match fs::read_to_string(file) {
            Ok(text) => text,
            Err(error) => return self.problem(format!("{shown}: it cannot be read, {}", why(&error))),
        };
        let library = match library_of(&text) {
            Ok(library) => library,
            Err(what) => return self.problem(format!("{shown}: {what}; install the driver anew")),
        };
        self.nvidia |= format!("{shown}{library}").to_lowercase().contains("nvidia");
        // With a slash it is a path, from the folder of the file; without, the system knows where.
        let path = if library.contains('/') {
            file.parent().unwrap_or(Path::new("")).join(&library)
        } else {
            PathBuf::from(&library)
        };
        match load(&path) {
            Ok(()) => self.fine(format!("{shown}: {} loads", path.display())),
            Err(error) => {
                let advice = advice(&error, &path);
                self.problem(format!("{shown}: its library cannot be loaded: {error}; {advice}"));
            }
        }
    }

    /// What drivers open, under a root.
    fn nodes(&mut self, root: &Path) {
        let nvidia = root.join("proc/driver/nvidia/version").exists();
        if nvidia && !self.nvidia {
            self.problem(
                "NVIDIA's kernel driver runs, and no file of its Vulkan driver (nvidia_icd.json) was found; install the \
                 driver's Vulkan part (on Debian nvidia-vulkan-icd); in a container, run it with \
                 NVIDIA_DRIVER_CAPABILITIES=all, or with `graphics` among them"
                    .to_owned(),
            );
        }
        let nodes = |folder: &str, prefix: &str| {
            let entries = fs::read_dir(root.join(folder)).into_iter().flatten().flatten();
            let mut nodes: Vec<_> =
                entries.filter(|entry| is_numbered(&entry.file_name().to_string_lossy(), prefix)).collect();
            nodes.sort_by_key(|entry| entry.file_name());
            nodes.into_iter().map(|entry| entry.path()).collect::<Vec<_>>()
        };
        let cards = nodes("dev", "nvidia");
        let control = root.join("dev/nvidiactl");
        if (nvidia || self.nvidia) && !control.exists() {
            self.problem(format!(
                "{} is missing, without which no NVIDIA card is seen; load the kernel driver (`nvidia-modprobe`); in a \
                 container, run it with --gpus all",
                control.display()
            ));
        }
        let renderers = nodes("dev/dri", "renderD");
        if cards.is_empty() && renderers.is_empty() {
            let dri = root.join("dev/dri");
            self.note(format!(
                "neither {}/renderD* nor {}/nvidia* is there: no GPU is seen, and only drivers that need none work; in a \
                 container, pass it in by --device {} or --gpus all",
                dri.display(),
                root.join("dev").display(),
                dri.display()
            ));
        }
        let control = control.exists().then_some(control);
        for node in control.into_iter().chain(cards).chain(renderers) {
            match File::options().read(true).write(true).open(&node) {
                Ok(_) => self.fine(format!("{} can be opened", node.display())),
                Err(error) => self.problem(refusal(&node, &error)),
            }
        }
    }

    /// Parts of NVIDIA's cards, and what does not choose among them.
    fn slices(&mut self) {
        let listed = Command::new("nvidia-smi").arg("-L").output();
        let listed = listed.map(|output| String::from_utf8_lossy(&output.stdout).into_owned()).unwrap_or_default();
        if listed.lines().any(|line| line.trim_start().starts_with("MIG ")) {
            self.problem(
                "a card is cut into slices by MIG (nvidia-smi -L): most such cards, as A100 and H100, have no Vulkan then; \
                 ask for a whole card, or end it with `nvidia-smi -mig 0`"
                    .to_owned(),
            );
        }
        if let Some(cards) = variable("CUDA_VISIBLE_DEVICES") {
            self.note(format!(
                "CUDA_VISIBLE_DEVICES={cards} does not choose among Vulkan's devices; --device and RAYWAVE_DEVICE do"
            ));
        }
    }

    /// What NVIDIA's driver opens beside its own libraries; without, it finds no card and does not say why.
    fn dispatch(&mut self, load: impl Fn(&str) -> Result<(), String>) {
        let missing: Vec<_> = ["libGLdispatch.so.0", "libGLX.so.0", "libEGL.so.1"]
            .into_iter()
            .filter(|name| load(name).is_err())
            .collect();
        if !missing.is_empty() {
            self.problem(format!(
                "NVIDIA's driver finds no card without libglvnd, and {} cannot be loaded: on Debian or Ubuntu `apt install \
                 {GLVND}`",
                missing.join(", ")
            ));
        }
    }

    fn devices(&mut self) {
        let found = Instance::new(false).and_then(|instance| instance.devices());
        let has_nvidia = found.as_ref().is_ok_and(|found| found.iter().any(|device| device.name.contains("NVIDIA")));
        if self.nvidia && !has_nvidia {
            self.dispatch(|name| load_any(Path::new(name)));
        }
        match found {
            Ok(devices) => {
                for device in devices {
                    match device.unusable {
                        None => {
                            self.has_device = true;
                            self.fine(format!("device {}", device.name));
                        }
                        Some(reason) => self.problem(format!("device {} cannot be used: {reason}", device.name)),
                    }
                }
            }
            // What leads to these has been told, unless it is between a driver and its device.
            Err(GpuError::NoLoader(_)) => {}
            Err(GpuError::NoDriver { .. }) if self.findings.iter().any(|f| f.verdict == Verdict::Problem) => {}
            Err(GpuError::NoDriver { cause }) => self.problem(format!("there is no device: {cause}")),
            Err(error) => self.problem(error.to_string()),
        }
    }
}

const FILES: &str = "VK_DRIVER_FILES";
/// Of loaders before 1.3.207, and understood by all since.
const OLD_FILES: &str = "VK_ICD_FILENAMES";
const ADDED_FILES: &str = "VK_ADD_DRIVER_FILES";
const SELECT: &str = "VK_LOADER_DRIVERS_SELECT";
const DISABLE: &str = "VK_LOADER_DRIVERS_DISABLE";

/// Debian's packages of libglvnd.
const GLVND: &str = "libglvnd0 libegl1 libgl1 libglx0 libopengl0 libgles2";

/// A variable of the environment, unless it is empty.
fn variable(name: &str) -> Option<String> {
    env::var_os(name).filter(|value| !value.is_empty()).map(|value| value.to_string_lossy().into_owned())
}

/// The folders in which the loader looks for files of drivers, in its order.
fn folders() -> Vec<PathBuf> {
    let home = |name: &str, folder: &str| {
        variable(name).map(PathBuf::from).or_else(|| Some(Path::new(&variable("HOME")?).join(folder)))
    };
    let list = |name: &str, usual: &str| {
        env::split_paths(&variable(name).unwrap_or_else(|| usual.to_owned())).collect::<Vec<_>>()
    };
    let mut folders: Vec<PathBuf> = home("XDG_CONFIG_HOME", ".config").into_iter().collect();
    folders.extend(list("XDG_CONFIG_DIRS", "/etc/xdg"));
    folders.push("/etc".into());
    folders.extend(home("XDG_DATA_HOME", ".local/share"));
    folders.extend(list("XDG_DATA_DIRS", "/usr/local/share:/usr/share"));
    folders.into_iter().map(|folder| folder.join("vulkan/icd.d")).collect()
}

/// The files of drivers in a folder.
fn manifests(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let paths = fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>()?;
    let mut paths: Vec<_> =
        paths.into_iter().filter(|path| path.extension().is_some_and(|extension| extension == "json")).collect();
    paths.sort();
    Ok(paths)
}

/// Why the loader leaves out a file of that name. What is selected is not disabled.
fn filtered(name: &str, select: Option<&str>, disable: Option<&str>) -> Option<String> {
    let matches = |globs: &str| globs.split(',').any(|glob| glob_matches(glob, name));
    match (select, disable) {
        (Some(select), _) if matches(select) => None,
        (Some(select), _) => Some(format!("it is left out, since {SELECT}={select} does not name it")),
        (None, Some(disable)) if matches(disable) => Some(format!("it is left out by {DISABLE}={disable}")),
        _ => None,
    }
}

/// By the loader's globs: an asterisk at either end, and any case.
fn glob_matches(glob: &str, name: &str) -> bool {
    let (glob, name) = (glob.to_lowercase(), name.to_lowercase());
    if ["~all~", "*", "**"].contains(&&*glob) {
        return true;
    }
    match (glob.strip_prefix('*'), glob.strip_suffix('*')) {
        (Some(rest), Some(_)) => name.contains(rest.trim_end_matches('*')),
        (Some(end), None) => name.ends_with(end),
        (None, Some(start)) => name.starts_with(start),
        (None, None) => name == glob,
    }
}

/// The library that the file of a driver names.
fn library_of(text: &str) -> Result<String, String> {
    let manifest: Value = serde_json::from_str(text).map_err(|error| format!("it is no JSON: {error}"))?;
    let library = manifest["ICD"]["library_path"].as_str();
    library.map(str::to_owned).ok_or_else(|| "it names no library (ICD.library_path)".to_owned())
}

/// Loads the library of a driver and gives it back.
#[cfg(unix)]
fn load(path: &Path) -> Result<(), String> {
    use libloading::os::unix::Library;
    // SAFETY: it is what the Vulkan loader does with the same file: a driver expects to be loaded.
    let library = unsafe { Library::new(path) }.map_err(|error| error.to_string())?;
    let has = |name: &[u8]| {
        // SAFETY: the symbol is looked for, and never used.
        unsafe { library.get::<*const ()>(name) }.is_ok()
    };
    let is_driver = has(b"vk_icdGetInstanceProcAddr\0") || has(b"vkGetInstanceProcAddr\0");
    if is_driver { Ok(()) } else { Err(format!("{}: it is no Vulkan driver", path.display())) }
}

/// Loads any library and gives it back.
#[cfg(unix)]
fn load_any(path: &Path) -> Result<(), String> {
    // SAFETY: those that are asked for are meant to be loaded by whoever draws.
    unsafe { libloading::os::unix::Library::new(path) }.map(drop).map_err(|error| error.to_string())
}

#[cfg(not(unix))]
fn load(_: &Path) -> Result<(), String> {
    Ok(())
}

#[cfg(not(unix))]
fn load_any(_: &Path) -> Result<(), String> {
    Ok(())
}

/// What to do where the system's linker says that of a driver's library.
fn advice(error: &str, library: &Path) -> String {
    // "libx.so.1: cannot open shared object file: No such file or directory" names the first library that is missing.
    let missing = error.split(':').next().filter(|_| error.contains("cannot open shared object file"));
    let Some(missing) = missing else { return "install the driver anew".to_owned() };
    let name = missing.rsplit('/').next().unwrap_or(missing);
    // Where NVIDIA's driver comes from outside, as in containers, what it needs does not come with it.
    let glvnd = ["libGLdispatch", "libGLX.", "libEGL.", "libGL.", "libOpenGL.", "libGLESv2."];
    let package = match name {
        name if glvnd.iter().any(|start| name.starts_with(start)) => Some(GLVND),
        "libX11.so.6" => Some("libx11-6"),
        "libXext.so.6" => Some("libxext6"),
        _ => None,
    };
    match package {
        Some(package) => format!("it needs {name}: on Debian or Ubuntu `apt install {package}`"),
        None if missing == library.to_string_lossy() => {
            "the file is a leftover, or names a library that is not mounted here; install the driver anew".to_owned()
        }
        None => format!("it needs {name}; install the package that has it"),
    }
}

/// Whether a name is a prefix and a number.
fn is_numbered(name: &str, prefix: &str) -> bool {
    let rest = name.strip_prefix(prefix).unwrap_or_default();
    !rest.is_empty() && rest.bytes().all(|byte| byte.is_ascii_digit())
}

fn why(error: &io::Error) -> String {
    match error.kind() {
        ErrorKind::NotFound => "which is not there".to_owned(),
        ErrorKind::PermissionDenied => "which this user may not read".to_owned(),
        _ => error.to_string(),
    }
}

/// What to do where a node cannot be opened.
fn refusal(node: &Path, error: &io::Error) -> String {
    let advice = match error.kind() {
        ErrorKind::PermissionDenied if node.to_string_lossy().contains("/dri/") => {
            "this user may not use it: `usermod -aG render USER`, or -aG video, and a new login; in a container also --device"
        }
        ErrorKind::PermissionDenied => {
            "this user may not use it: its mode or its group must allow reading and writing; in a container also --gpus or \
             --device"
        }
        _ => "no driver can use it",
    };
    format!("{} cannot be opened ({error}); {advice}", node.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problems(found: &Discovery) -> Vec<&str> {
        let problems = found.findings.iter().filter(|finding| finding.verdict == Verdict::Problem);
        problems.map(|finding| &*finding.text).collect()
    }

    #[test]
    fn filters_match_as_the_loaders_do() {
        let name = "lvp_icd.x86_64.json";
        for (select, disable, is_kept) in [
            (None, None, true),
            (Some("lvp*"), None, true),
            (Some("LVP_ICD.X86_64.JSON"), None, true),
            (Some("lvp_icd"), None, false),
            (Some("intel*,*icd.x86*"), None, true),
            (Some("intel*"), None, false),
            (None, Some("*x86_64.json"), false),
            (None, Some("~all~"), false),
            (None, Some("*"), false),
            (None, Some("radeon*"), true),
            (Some("lvp*"), Some("~all~"), true),
        ] {
            assert_eq!(filtered(name, select, disable).is_none(), is_kept, "{select:?} {disable:?}");
        }
    }

    #[test]
    fn nodes_tell_of_nvidia_and_of_containers() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let place = |path: &str| {
            let path = root.path().join(path);
            fs::create_dir_all(path.parent().expect("it has one")).expect("a temporary folder");
            fs::write(path, "").expect("a temporary file");
        };
        let look = |nvidia| {
            let mut found = Discovery { nvidia, ..Discovery::default() };
            found.nodes(root.path());
            found
        };
        // No GPU at all, which is no problem for software.
        let found = look(false);
        assert_eq!(found.findings.len(), 1);
        assert!(found.findings[0].verdict == Verdict::Note && found.findings[0].text.contains("no GPU is seen"));
        // A driver without a card.
        assert!(problems(&look(true))[0].contains("dev/nvidiactl is missing"));
        place("proc/driver/nvidia/version");
        place("dev/nvidiactl");
        place("dev/nvidia0");
        place("dev/nvidia-uvm");
        let found = look(false);
        assert!(matches!(problems(&found)[..], [only] if only.contains("NVIDIA_DRIVER_CAPABILITIES")), "{found:?}");
        let found = look(true);
        assert!(problems(&found).is_empty() && found.findings.len() == 2, "{found:?}");
        // A node that nobody can open, not even the superuser.
        fs::create_dir_all(root.path().join("dev/dri/renderD128")).expect("a temporary folder");
        assert!(problems(&look(true))[0].contains("renderD128 cannot be opened"));
    }

    #[test]
    fn libglvnd_is_asked_for_where_nvidia_finds_no_card() {
        let mut found = Discovery::default();
        found.dispatch(|_| Ok(()));
        assert_eq!(found.findings, []);
        found.dispatch(|name| if name.contains("EGL") { Err(String::new()) } else { Ok(()) });
        assert!(matches!(problems(&found)[..], [only] if only.contains("libEGL.so.1 cannot be loaded")));
    }

    #[test]
    fn what_may_not_be_opened_names_the_group() {
        let denied = io::Error::from(ErrorKind::PermissionDenied);
        assert!(refusal(Path::new("/dev/dri/renderD128"), &denied).contains("usermod -aG render"));
        assert!(refusal(Path::new("/dev/nvidia0"), &denied).contains("--gpus"));
    }

    #[test]
    fn missing_libraries_are_named() {
        let said = |name: &str| format!("{name}: cannot open shared object file: No such file or directory");
        let library = Path::new("libGLX_nvidia.so.0");
        assert!(advice(&said("libGLdispatch.so.0"), library).contains("libglvnd0"));
        assert!(advice(&said("libXext.so.6"), library).contains("libxext6"));
        assert!(advice(&said("libdrm.so.2"), library).contains("it needs libdrm.so.2"));
        assert!(advice(&said("libGLX_nvidia.so.0"), library).contains("not mounted here"));
        assert!(advice("/x.so: invalid ELF header", Path::new("/x.so")).contains("anew"));
    }
}
