//! The scripts of a bundle, `./x bundle`, among programs that only say what tests would.

use std::fs;
use std::process::Command;

use crate::install::install;
use crate::project::project_file;
use tempfile::TempDir;

/// A bundle that holds these shell scripts.
fn bundle(programs: &[(&str, &str)]) -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let place = |name: &str| folder.path().join(name);
    for name in ["run-tests", "environment"] {
        install(&project_file("bundle").join(name), &place(name));
    }
    fs::create_dir(place("test-programs")).expect("a temporary folder");
    for (name, script) in programs {
        fs::write(place("script"), format!("#!/bin/bash\n{script}\n")).expect("a temporary file");
        install(&place("script"), &place(name));
    }
    folder
}

/// Stdout of `run-tests`, and its exit code.
fn run_tests(bundle: &TempDir, arguments: &[&str]) -> (String, Option<i32>) {
    let mut command = Command::new(bundle.path().join("run-tests"));
    let output = command.current_dir("/").args(arguments).output().expect("bash starts");
    (String::from_utf8(output.stdout).expect("text"), output.status.code())
}

const RAYWAVE: (&str, &str) = ("raywave", "echo '0 Abacus  (chosen)'");

/// A program of tests in a module, of which another script says what the tests would.
fn with_list(module: &str, script: &str) -> String {
    format!(
        "if [ \"$1\" = --list ]; then echo '{module}::adds: test'; echo '{module}::counts: test'; exit; fi; {script}"
    )
}

/// A program's words, as cargo's harness has them.
fn words(passed: u32, failed: u32) -> String {
    let verdict = if failed > 0 { "FAILED" } else { "ok" };
    format!(
        "echo 'test result: {verdict}. {passed} passed; {failed} failed; 1 ignored; 0 measured; 0 filtered out; \
         finished in 0.10s'"
    )
}

#[test]
fn counts_of_test_programs_are_summed() {
    let right = words(3, 0);
    let told = format!("[ \"$PWD\" = \"$RAYWAVE_PROJECT\" ] && echo 'NOT TESTED: adds: no abacus' && {}", words(4, 0));
    let told = with_list("b", &format!("[ \"$2\" = b:: ] && {told}"));
    let bundle = bundle(&[RAYWAVE, ("test-programs/unit", &right), ("test-programs/gpu", &told)]);
    let (text, code) = run_tests(&bundle, &[]);
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("device: Abacus"), "{text}");
    let sum = text.lines().find(|line| line.starts_with("all ")).expect("a sum");
    // One is ignored in each, and one had nothing to test.
    assert!(sum.contains("   6 passed    0 failed    3 not tested"), "{text}");
    assert!(text.contains("NOT TESTED: adds: no abacus"), "{text}");
    // One of them.
    let (text, _) = run_tests(&bundle, &["unit"]);
    assert!(text.contains("all                     3 passed"), "{text}");
    assert_eq!(run_tests(&bundle, &["--list"]).0, "b\nunit\n");
    assert_eq!(run_tests(&bundle, &["c"]).1, Some(2));
}

#[test]
fn tests_are_found_by_name_in_every_program() {
    let told = with_list("b", &format!("[ \"$*\" = '--show-output adds' ] && {}", words(1, 0)));
    let bundle = bundle(&[RAYWAVE, ("test-programs/unit", &words(0, 0)), ("test-programs/gpu", &told)]);
    let (text, code) = run_tests(&bundle, &["--", "adds"]);
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("all                     1 passed"), "{text}");
    assert_eq!(run_tests(&bundle, &["b", "--", "adds"]).1, Some(2));
}

#[test]
fn failures_and_broken_programs_are_told() {
    let right = words(3, 0);
    let failing = format!("echo 'test abacus::adds ... FAILED'; {}; exit 101", words(2, 1));
    let broken = "echo 'out of beads'; exit 7";
    // All passed, and then it fell.
    let late = format!("{right}; kill -SEGV $$");
    let bundle = bundle(&[
        RAYWAVE,
        ("test-programs/unit", &right),
        ("test-programs/broken", broken),
        ("test-programs/gpu", &with_list("failing", &failing)),
        ("test-programs/program", &with_list("late", &late)),
    ]);
    let (text, code) = run_tests(&bundle, &[]);
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("FAILED: abacus::adds") && text.contains("exit code 7: out of beads"), "{text}");
    let sum = text.lines().find(|line| line.starts_with("all ")).expect("a sum");
    assert!(sum.contains("   8 passed    3 failed    3 not tested"), "{text}");
    assert!(fs::read_to_string(bundle.path().join("test-output/failing.log")).is_ok());
}
