//! What the build makes of each kernel, and what is left of it for a render, is valid SPIR-V by the reference validator.

use std::collections::HashMap;
use std::io::Write;
use std::process::{Command, Stdio};

use crate::not_tested::not_tested;
use rayon::prelude::*;
use raywave::constants::Specialization;
use raywave::shaders::{Arithmetic, Build, Edition, Form, Forms, KERNELS, Promises, portable_library};
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
    let mut cases = Vec::new();
    for kernel in KERNELS {
        for variant in kernel.variants {
            for arithmetic in arithmetics.clone() {
                cases.push((kernel.name, variant, &constants, arithmetic));
            }
            cases.push((kernel.name, variant, &nothing, Arithmetic::Native));
        }
    }
    assert!(cases.len() > 500, "the kernels were found");
    let refused: Vec<String> = cases
        .into_par_iter()
        .filter_map(|(name, variant, constants, arithmetic)| {
            let built =
                variant.specialize(&Build { constants, arithmetic, driver: None, promises }, portable_library());
            refusal(&built.words).map(|said| format!("{name} with {arithmetic:?}: {said}"))
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
    let access = raywave::shaders::Access { texel_fetch: false, subgroup_ballot: false };
    let mut words = kernel.variant(Edition::Plain, access).words();
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
    for variant in KERNELS.iter().flat_map(|kernel| kernel.variants) {
        let module = variant.module();
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
