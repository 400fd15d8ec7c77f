//! What `devices --why` says where there is no device, each cause made by hand.
#![cfg(target_os = "linux")]

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::command_line::{Folder, text};
use crate::common::install::install;
use crate::common::not_tested::not_tested;

/// What says to the Vulkan loader which drivers to take.
const VARIABLES: [&str; 5] = [
    "VK_DRIVER_FILES",
    "VK_ICD_FILENAMES",
    "VK_ADD_DRIVER_FILES",
    "VK_LOADER_DRIVERS_SELECT",
    "VK_LOADER_DRIVERS_DISABLE",
];

/// The program in an environment that says nothing of drivers, but what is told.
fn run(folder: &Folder, arguments: &[&str], variables: &[(&str, &OsStr)]) -> Output {
    let mut command: Command = folder.command(arguments);
    for name in VARIABLES.iter().chain(&["RAYWAVE_DEVICE", "CUDA_VISIBLE_DEVICES"]) {
        command.env_remove(name);
    }
    command.envs(variables.iter().copied()).output().expect("the program starts")
}

/// That `--why` names the cause as a problem, and so does what a command says that needs a device.
fn assert_told(folder: &Folder, variables: &[(&str, &OsStr)], cause: &str) {
    let output = run(folder, &["devices", "--why"], variables);
    let told = text(&output.stdout);
    let problem = told.lines().find(|line| line.starts_with("problem ") && line.contains(cause));
    assert!(problem.is_some(), "{variables:?}, not {cause}:\n{told}");
    assert_eq!(output.status.code(), Some(2), "{told}");

    let output = run(folder, &["render", "--quiet", "-o", "a.png"], variables);
    let said = text(&output.stderr);
    assert!(said.contains(cause), "{said}");
    assert!(said.lines().count() == 1 && said.contains("; `raywave devices --why` says more"), "{said}");
    let installs = said.contains("apt install mesa-vulkan-drivers");
    assert_eq!(installs, cause.contains("is installed"), "{said}");
}

/// A driver's file in a folder where the loader looks, `HOME`.
fn driver(folder: &Folder, contents: &str) -> PathBuf {
    let path = folder.path(".local/share/vulkan/icd.d/fake_icd.json");
    fs::create_dir_all(path.parent().expect("it has one")).expect("a temporary folder");
    fs::write(&path, contents).expect("a temporary file");
    path
}

fn naming(library: &Path) -> String {
    format!(r#"{{"file_format_version": "1.0.0", "ICD": {{"library_path": {library:?}, "api_version": "1.2.0"}}}}"#)
}

#[test]
fn where_all_is_well_nothing_is_a_problem() {
    let output = Folder::new().command(&["devices", "--why"]).output().expect("the program starts");
    let told = text(&output.stdout);
    assert!(output.status.success() && told.contains("ok       device "), "{told}");
}

#[test]
fn variables_that_name_nothing_are_told() {
    let folder = Folder::new();
    fs::create_dir(folder.path("empty")).expect("a temporary folder");
    let (empty, nowhere) = (folder.path("empty"), folder.path("nowhere.json"));
    assert_told(&folder, &[("VK_DRIVER_FILES", nowhere.as_os_str())], "VK_DRIVER_FILES names ");
    assert_told(&folder, &[("VK_ICD_FILENAMES", nowhere.as_os_str())], "nowhere.json, which is not there");
    assert_told(&folder, &[("VK_DRIVER_FILES", empty.as_os_str())], "in which no .json file is");
    assert_told(&folder, &[("VK_DRIVER_FILES", OsStr::new(""))], "VK_DRIVER_FILES is set and empty");
    let both = [("VK_DRIVER_FILES", nowhere.as_os_str()), ("VK_ICD_FILENAMES", nowhere.as_os_str())];
    let told = text(&run(&folder, &["devices", "--why"], &both).stdout);
    assert!(told.contains("note     VK_ICD_FILENAMES is ignored"), "{told}");
}

#[test]
fn filters_that_leave_nothing_are_told() {
    let folder = Folder::new();
    let file = driver(&folder, &naming(Path::new("libc.so.6")));
    for (name, globs) in [("VK_LOADER_DRIVERS_SELECT", "none*"), ("VK_LOADER_DRIVERS_DISABLE", "*ICD.json")] {
        let variables = [("VK_DRIVER_FILES", file.as_os_str()), (name, OsStr::new(globs))];
        assert_told(&folder, &variables, &format!("{name}={globs} leaves out every driver"));
    }
}

#[test]
fn folders_without_drivers_and_drivers_without_libraries_are_told() {
    if fs::read_dir("/etc/vulkan/icd.d").is_ok_and(|mut files| files.next().is_some()) {
        return not_tested("folders without drivers: /etc/vulkan/icd.d, which is always looked at, has one");
    }
    let folder = Folder::new();
    let home = folder.path("");
    let nowhere = OsStr::new("/nowhere");
    let variables: Vec<(&str, &OsStr)> =
        [("XDG_CONFIG_HOME", nowhere), ("XDG_CONFIG_DIRS", nowhere), ("XDG_DATA_DIRS", nowhere)].to_vec();
    let mut at_home = variables.clone();
    at_home.extend([("HOME", home.as_os_str()), ("XDG_DATA_HOME", OsStr::new(""))]);
    assert_told(&folder, &at_home, "no driver is installed");

    driver(&folder, "{");
    assert_told(&folder, &at_home, "fake_icd.json: it is no JSON");
    driver(&folder, "{}");
    assert_told(&folder, &at_home, "it names no library");
    driver(&folder, &naming(Path::new("libGLX_nowhere.so.0")));
    assert_told(&folder, &at_home, "libGLX_nowhere.so.0: cannot open shared object file");
    driver(&folder, &naming(&folder.path("none.so")));
    assert_told(&folder, &at_home, "none.so: cannot open shared object file");
    driver(&folder, &naming(Path::new("libc.so.6")));
    assert_told(&folder, &at_home, "it is no Vulkan driver");

    // Another library, in which the name of one that it needs is misspelled.
    let maps = fs::read_to_string("/proc/self/maps").expect("Linux has it");
    let gcc = maps.lines().find_map(|line| line.split_whitespace().last().filter(|path| path.contains("/libgcc_s.so")));
    let mut library = fs::read(gcc.expect("tests are linked with it")).expect("it can be read");
    let name = b"libc.so.6\0";
    let places: Vec<usize> = (0..library.len()).filter(|&at| library[at..].starts_with(name)).collect();
    assert!(!places.is_empty(), "it needs the C library");
    places.into_iter().for_each(|at| library[at + 3] = b'q');
    folder.write("broken.so", library);
    driver(&folder, &naming(&folder.path("broken.so")));
    assert_told(&folder, &at_home, "it needs libq.so.6");
}

#[test]
fn a_loader_that_cannot_be_loaded_is_told() {
    let folder = Folder::new();
    for name in ["libvulkan.so.1", "libvulkan.so"] {
        folder.write(name, "no library");
    }
    let home = folder.path("");
    assert_told(&folder, &[("LD_LIBRARY_PATH", home.as_os_str())], "libvulkan.so");
}

#[test]
fn slices_are_told_and_cudas_variable_too() {
    let folder = Folder::new();
    let list = "GPU 0: NVIDIA H100 80GB HBM3 (UUID: GPU-1)\n  MIG 1g.10gb     Device  0: (UUID: MIG-2)";
    folder.write("script", format!("#!/bin/sh\necho '{list}'\n"));
    install(&folder.path("script"), &folder.path("nvidia-smi"));
    let path = format!("{}:{}", folder.path("").display(), std::env::var("PATH").expect("it is set"));
    let told = |cards: &str| {
        let variables = [("PATH", OsStr::new(&path)), ("CUDA_VISIBLE_DEVICES", OsStr::new(cards))];
        text(&run(&folder, &["devices", "--why"], &variables).stdout)
    };
    assert!(told("1").contains("problem  a card is cut into slices by MIG"), "{}", told("1"));
    assert!(told("1").contains("note     CUDA_VISIBLE_DEVICES=1 does not choose"), "{}", told("1"));
    assert!(!told("").contains("CUDA_VISIBLE_DEVICES"), "{}", told(""));
}
