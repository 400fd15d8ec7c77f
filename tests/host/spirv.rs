//! What the build makes of each kernel, and what is left of it for a render, is valid SPIR-V by the reference validator.

use std::collections::HashMap;
use std::io::Write;
use std::process::{Command, Stdio};

use crate::not_tested::not_tested;
use rayon::prelude::*;
use raywave::constants::Specialization;
use raywave::shaders::{Access, Arithmetic, Build, Edition, Form, Forms, KERNELS, Promises, portable_library};
use rspirv::dr::Block;
use rspirv::spirv::Op;

/// Whether there is a validator; where changes are gated there must be.
fn has_validator() -> bool {
    let found = Command::new("spirv-val").arg("--version").stdout(Stdio::null()).status().is_ok();
    if !found {
        assert!(std::env::var_os("CI").is_none(), "spirv-val is missing; install spirv-tools");
        not_tested("spirv-val is not installed");
    }
    found
}

/// Why the validator refuses a module; `None` where it is valid.
fn refusal(words: &[u32]) -> Option<String> {
    let mut validator = Command::new("spirv-val")
        .args(["--target-env", "vulkan1.2", "-"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the validator starts");
    let bytes = bytemuck::cast_slice(words);
    validator.stdin.take().expect("stdin is a pipe").write_all(bytes).expect("it reads the module");
    let output = validator.wait_with_output().expect("it ends");
    let said = [output.stdout, output.stderr].concat();
    (!output.status.success()).then(|| String::from_utf8_lossy(&said).trim().to_owned())
}

#[test]
fn every_kernel_is_valid() {
    if !has_validator() {
        return;
    }
    let forms = |form| Arithmetic::Portable(Forms { division: form, reciprocal: form, root: form });
    let portable = [Form::Native, Form::ByFma, Form::ByIntegers].map(forms);
    let arithmetics = [Arithmetic::Native, Arithmetic::Contracted].into_iter().chain(portable);
    let promises = Promises { special_values: true, nearest_rounding: true, ..Promises::default() };
    // Those of a scene that has everything, and of one that has nothing.
    let constants = Specialization::DEFAULT.words();
    let nothing = vec![0; constants.len()];
    let device = |texel_fetch, subgroup_ballot| Access { texel_fetch, subgroup_ballot };
    let both = device(true, true);
    let mut cases = Vec::new();
    for kernel in KERNELS {
        cases.extend(arithmetics.clone().map(|arithmetic| (kernel, &constants, both, Edition::Plain, arithmetic)));
        let native = |constants, access, edition| (kernel, constants, access, edition, Arithmetic::Native);
        cases.extend([device(false, false), device(false, true)].map(|a| native(&constants, a, Edition::Plain)));
        cases.extend([device(false, false), both].map(|a| native(&constants, a, Edition::Counting)));
        cases.extend([device(false, false), both].map(|a| native(&nothing, a, Edition::Plain)));
    }
    assert!(cases.len() > 150, "the kernels were found");
    let refused: Vec<String> = cases
        .into_par_iter()
        .filter_map(|(kernel, constants, access, edition, arithmetic)| {
            let build = Build { constants, access, edition, arithmetic, driver: None, promises };
            let built = kernel.specialize(&build, portable_library());
            refusal(&built.words).map(|said| format!("{} with {arithmetic:?}, {access:?}: {said}", kernel.name))
        })
        .collect();
    assert!(refused.is_empty(), "{} refused, first:\n{}", refused.len(), refused[0]);
}

#[test]
fn the_validator_refuses_what_is_broken() {
    if !has_validator() {
        return;
    }
    let kernel = KERNELS.iter().find(|kernel| kernel.name == "connect").expect("there is such a kernel");
    let mut words = kernel.words();
    assert_eq!(refusal(&words), None);
    // Without its last instruction the function has no end.
    words.pop();
    assert!(refusal(&words).is_some());
}

fn label(block: &Block) -> u32 {
    block.label.as_ref().and_then(|label| label.result_id).expect("a block has a label")
}

#[test]
fn loops_begin_without_phis_and_continue_blocks_without_stores() {
    let mut loops = 0;
    for kernel in KERNELS {
        let module = kernel.module();
        for function in &module.functions {
            let blocks: HashMap<u32, &Block> = function.blocks.iter().map(|block| (label(block), block)).collect();
            for head in &function.blocks {
                let Some(merge) = head.instructions.iter().find(|i| i.class.opcode == Op::LoopMerge) else {
                    continue;
                };
                loops += 1;
                assert!(head.instructions.iter().all(|i| i.class.opcode != Op::Phi));
                let code = &blocks[&merge.operands[1].id_ref_any().expect("a loop has a continue block")].instructions;
                let does = |op| code.iter().any(|i| i.class.opcode == op);
                // What else is in a continue block, as a step to the next number, may be stored there.
                let only_stores =
                    code.iter().all(|i| matches!(i.class.opcode, Op::Store | Op::Line | Op::NoLine | Op::Branch));
                assert!(!(does(Op::Store) && only_stores));
            }
        }
    }
    assert!(loops > 100, "kernels have loops");
}
