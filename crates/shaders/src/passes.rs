//! What is done to every kernel when it is built.

use std::collections::BTreeMap;

use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{Op, StorageClass};

use crate::ids::{id_of, is_line, label};

/// Takes out the source text, and the lines that instructions come from: more than half of a module, of use to
/// profilers only.
pub fn remove_source(module: &mut Module) {
    module.debug_string_source.clear();
    module.types_global_values.retain(|i| !is_line(i));
    for block in module.functions.iter_mut().flat_map(|function| &mut function.blocks) {
        block.instructions.retain(|i| !is_line(i));
    }
}

/// Makes variables again of what loops carry from turn to turn, which the optimizer has made phis.
///
/// Mesa stores a phi's value at the end of the block that it comes from. For the next turn that is the loop's continue
/// block, which Mesa puts at the start of the loop, under a flag that is false in the first turn: so each value is
/// selected by the flag at the start of every turn. What a variable is given in front of the continue block leaves it
/// empty, and there is no flag. On lavapipe traversal is 1.13 times as fast for it.
pub fn keep_loops_in_variables(module: &mut Module) {
    let mut bound = module.header.as_ref().expect("a module has a header").bound;
    let mut new_id = || {
        bound += 1;
        bound - 1
    };
    // Of each type of value, the type of a pointer to one.
    let mut pointers = BTreeMap::new();
    for function in &mut module.functions {
        let places: BTreeMap<u32, usize> = (0..).zip(&function.blocks).map(|(i, block)| (label(block), i)).collect();
        let mut before = vec![Vec::new(); function.blocks.len()];
        for (i, block) in function.blocks.iter().enumerate() {
            let end = block.instructions.last().expect("a block has an end");
            for target in end.operands.iter().filter_map(Operand::id_ref_any).filter_map(|id| places.get(&id)) {
                before[*target].push(i);
            }
        }
        let mut variables = Vec::new();
        let mut stores = Vec::new();
        for head in &mut function.blocks {
            if !head.instructions.iter().any(|i| i.class.opcode == Op::LoopMerge) {
                continue;
            }
            for phi in head.instructions.iter_mut().filter(|i| i.class.opcode == Op::Phi) {
                let value_type = phi.result_type.expect("a phi has a type");
                let pointer = *pointers.entry(value_type).or_insert_with(&mut new_id);
                let variable = new_id();
                let class = Operand::StorageClass(StorageClass::Function);
                variables.push(Instruction::new(Op::Variable, Some(pointer), Some(variable), vec![class]));
                for pair in phi.operands.chunks_exact(2) {
                    stores.push((places[&id_of(&pair[1])], variable, pair[0].clone()));
                }
                let from = vec![Operand::IdRef(variable)];
                *phi = Instruction::new(Op::Load, Some(value_type), phi.result_id, from);
            }
        }
        for (place, variable, value) in stores {
            let is_empty = function.blocks[place].instructions.iter().filter(|i| !is_line(i)).count() == 1;
            let passed = is_empty && !before[place].is_empty();
            for place in if passed { before[place].clone() } else { vec![place] } {
                let code = &mut function.blocks[place].instructions;
                let merges = |i: &Instruction| matches!(i.class.opcode, Op::SelectionMerge | Op::LoopMerge);
                let end = code.iter().position(merges).unwrap_or(code.len() - 1);
                let operands = vec![Operand::IdRef(variable), value.clone()];
                code.insert(end, Instruction::new(Op::Store, None, None, operands));
            }
        }
        if let Some(first) = function.blocks.first_mut() {
            first.instructions.splice(..0, variables);
        }
    }
    for (value_type, id) in pointers {
        let operands = vec![Operand::StorageClass(StorageClass::Function), Operand::IdRef(value_type)];
        module.types_global_values.push(Instruction::new(Op::TypePointer, None, Some(id), operands));
    }
    module.header.as_mut().expect("as above").bound = bound;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ids::function_id;
    use crate::small;

    #[test]
    fn loops_without_phis_compute_the_same() {
        for full in [false, true] {
            let before = small::swapping_loop(full);
            let mut after = before.clone();
            keep_loops_in_variables(&mut after);
            let phis = |module: &Module| module.all_inst_iter().filter(|i| i.class.opcode == Op::Phi).count();
            assert_eq!((phis(&before), phis(&after)), (3, 0));
            for turns in 0..5 {
                assert_eq!(small::run(&after, &[turns]), small::run(&before, &[turns]));
            }
        }
        assert_eq!(small::run(&small::swapping_loop(false), &[3]), 20, "three exchanges are one");
    }

    #[test]
    fn an_empty_continue_block_stays_empty() {
        let mut module = small::swapping_loop(false);
        keep_loops_in_variables(&mut module);
        let blocks = &module.functions[0].blocks;
        let merges: Vec<_> =
            module.all_inst_iter().filter(|i| i.class.opcode == Op::LoopMerge).map(|i| id_of(&i.operands[1])).collect();
        let next = blocks.iter().find(|block| label(block) == merges[0]).expect("the loop has a continue block");
        assert_eq!(next.instructions.len(), 1);
    }

    #[test]
    fn ids_stay_below_the_bound() {
        let mut module = small::swapping_loop(true);
        keep_loops_in_variables(&mut module);
        let bound = module.header.as_ref().expect("a module has a header").bound;
        let ids: Vec<u32> = module.all_inst_iter().filter_map(|i| i.result_id).collect();
        assert!(ids.iter().all(|id| *id < bound));
        let distinct: std::collections::BTreeSet<u32> = ids.iter().copied().collect();
        assert_eq!(distinct.len(), ids.len(), "no id is given twice");
    }

    #[test]
    fn lines_and_source_go_and_code_stays() {
        let mut b = small::builder();
        let file = b.string("shade.comp");
        let buffer = small::buffer(&mut b, "radiances", 0, 0);
        small::main(&mut b, |b| {
            b.line(file, 7, 0);
            let first = small::first_of(b, buffer);
            let uint = b.type_int(32, 0);
            let value = b.load(uint, None, first, None, []).expect("a block is open");
            b.no_line();
            b.store(first, value, None, []).expect("a block is open");
        });
        let mut module = b.module();
        let lines = |module: &Module| module.all_inst_iter().filter(|i| is_line(i)).count();
        assert!(lines(&module) > 0 && !module.debug_string_source.is_empty());
        let main = function_id(&module.functions[0]);
        remove_source(&mut module);
        assert_eq!(lines(&module), 0);
        assert!(module.debug_string_source.is_empty());
        assert_eq!(function_id(&module.functions[0]), main);
        assert_eq!(module.functions[0].blocks[0].instructions.len(), 4, "access, load, store, return");
    }
}
