//! What a tool that captures the calls sees: a name of every object, and every launch in the region of its kernel. The
//! tool is gfxreconstruct, which is a layer and a program.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use crate::common::not_tested::not_tested;
use crate::common::project::{program, project_file};
use serde_json::Value;

const LAYER: &str = "VK_LAYER_LUNARG_gfxreconstruct";

/// The calls of a render, each with its arguments; none where the tool is missing.
fn calls(folder: &Path, flags: &[&str]) -> Option<Vec<(String, Value)>> {
    let convert = || Command::new("gfxrecon-convert");
    convert().arg("--version").output().ok()?;
    let mut render = Command::new(program());
    render.arg("render").arg(project_file("scenes/cornell-glass.toml")).args(flags);
    render.args(["--width", "16", "--height", "16", "--samples", "2", "--max-bounces", "2", "--quiet", "-o", "a.exr"]);
    render.current_dir(folder).env("RAYWAVE_CACHE", "off").env("VK_INSTANCE_LAYERS", LAYER);
    render.env("GFXRECON_CAPTURE_FILE", "a.gfxr").env("GFXRECON_CAPTURE_FILE_TIMESTAMP", "false");
    let output = render.output().expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let output = convert().args(["a.gfxr", "--output", "a.json"]).current_dir(folder).output();
    let output = output.expect("the converter starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = std::fs::read_to_string(folder.join("a.json")).expect("the calls are there");
    // A call stands on a line of its own, an element of a list.
    let call = |line: &str| {
        let mut line: Value = serde_json::from_str(line.trim().trim_matches(['[', ']', ','])).ok()?;
        let function = line.get_mut("vkFunc")?;
        Some((function["name"].as_str()?.to_owned(), function["args"].take()))
    };
    Some(text.lines().filter_map(call).collect())
}

#[test]
fn a_tool_sees_every_name_and_every_launch_in_its_region() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for scheduler in ["wavefront", "bounce", "megakernel"] {
        let Some(calls) = calls(folder.path(), &["--scheduler", scheduler, "--labels"]) else {
            return not_tested("names and labels as a tool sees them: gfxreconstruct is not installed");
        };
        let names: BTreeMap<u64, &str> = calls
            .iter()
            .filter(|(call, _)| call == "vkSetDebugUtilsObjectNameEXT")
            .filter_map(|(_, of)| {
                Some((of["pNameInfo"]["objectHandle"].as_u64()?, of["pNameInfo"]["pObjectName"].as_str()?))
            })
            .collect();
        let (mut open, mut bound, mut launches, mut made) = (Vec::new(), 0, Vec::new(), 0);
        for (call, of) in &calls {
            match call.as_str() {
                "vkCmdBeginDebugUtilsLabelEXT" => open.push(of["pLabelInfo"]["pLabelName"].as_str().expect("a name")),
                "vkCmdEndDebugUtilsLabelEXT" => assert!(open.pop().is_some(), "{scheduler}: what is closed was open"),
                "vkEndCommandBuffer" => assert!(open.is_empty(), "{scheduler}: {open:?} is left open"),
                "vkCmdBindPipeline" => bound = of["pipeline"].as_u64().expect("a handle"),
                "vkCmdDispatch" | "vkCmdDispatchIndirect" => {
                    let region = open.last().copied().unwrap_or_default();
                    let kernel = names.get(&bound).copied().unwrap_or_default();
                    assert!(!kernel.is_empty() && region.ends_with(kernel), "{scheduler}: {kernel} runs in {open:?}");
                    launches.push(open.join(" > "));
                }
                _ => {}
            }
            // Those of one object; pipelines, sets and command buffers are made in lists.
            let new = |field: &str| of.get(field).and_then(Value::as_u64);
            let object = ["pBuffer", "pView", "pShaderModule", "pSetLayout", "pPipelineLayout", "pFence", "pQueryPool"];
            let object = object.into_iter().filter(|_| call.starts_with("vkCreate")).find_map(new);
            let listed = ["pPipelines", "pDescriptorSets", "pCommandBuffers"];
            let is_made = call.starts_with("vkCreate") || call.starts_with("vkAllocate");
            let listed = listed.into_iter().filter(|_| is_made).find_map(|field| of.get(field)?.as_array());
            for handle in object.into_iter().chain(listed.into_iter().flatten().filter_map(Value::as_u64)) {
                assert!(names.get(&handle).is_some_and(|name| !name.is_empty()), "{scheduler}: {call} has no name");
                made += 1;
            }
        }
        assert!(made > 20, "{scheduler}: {made} objects");
        let is_there = |region: &str| launches.iter().any(|launch| launch == region);
        let expected: &[&str] = match scheduler {
            "wavefront" => &["generate", "bounce 0 > extend", "bounce 2 > connect", "no workgroup of shade"],
            "bounce" => &["bounce 0 > bounce", "bounce 2 > bounce", "resolve"],
            _ => &["megakernel", "resolve"],
        };
        assert!(expected.iter().all(|region| is_there(region)), "{scheduler}: {expected:?} in {launches:?}");
    }
}

#[test]
fn without_labels_nothing_is_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let Some(calls) = calls(folder.path(), &[]) else {
        return not_tested("renders without labels: gfxreconstruct is not installed");
    };
    assert!(!calls.is_empty() && calls.iter().all(|(call, _)| !call.contains("DebugUtils")), "a call for nobody");
}
