//! Ids of a module, and what is said of them.

use std::collections::HashMap;

use rspirv::dr::{Block, Function, Instruction, Module, Operand};
use rspirv::spirv::{Decoration, Op};

/// The id that an operand is.
pub fn id_of(operand: &Operand) -> u32 {
    operand.id_ref_any().expect("the operand is an id")
}

/// The id of a function.
pub fn function_id(function: &Function) -> u32 {
    function.def.as_ref().and_then(|def| def.result_id).expect("a function has an id")
}

/// The id of a block.
pub fn label(block: &Block) -> u32 {
    block.label.as_ref().and_then(|label| label.result_id).expect("a block has a label")
}

/// The lines that instructions come from are no code.
pub fn is_line(instruction: &Instruction) -> bool {
    matches!(instruction.class.opcode, Op::Line | Op::NoLine)
}

/// Names of ids.
pub fn names(module: &Module) -> HashMap<u32, String> {
    let name = |i: &Instruction| match (&i.operands[..], i.class.opcode) {
        ([Operand::IdRef(id), Operand::LiteralString(name)], Op::Name) => Some((*id, name.clone())),
        _ => None,
    };
    module.debug_names.iter().filter_map(name).collect()
}

/// The number that a decoration gives each id that has it.
pub fn decorations(module: &Module, wanted: Decoration) -> HashMap<u32, u32> {
    let value = |i: &Instruction| match (&i.operands[..], i.class.opcode) {
        ([Operand::IdRef(id), Operand::Decoration(which), Operand::LiteralBit32(value)], Op::Decorate)
            if *which == wanted =>
        {
            Some((*id, *value))
        }
        _ => None,
    };
    module.annotations.iter().filter_map(value).collect()
}
