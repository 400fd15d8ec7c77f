//! What is left of a kernel once its specialization constants are known.
//!
//! Drivers drop the code that a constant rules out, but a buffer that only such code uses must still
//! be bound: to Vulkan it is part of the kernel. So it is taken out here, and what it costs is known
//! without a driver.

use std::collections::{HashMap, HashSet};

use rspirv::binary::Assemble;
use rspirv::dr::{Block, Instruction, Module, Operand};
use rspirv::spirv::{Capability, Decoration, ExecutionMode, Op};

use crate::arithmetic::{self, Arithmetic};
use crate::ids::{decorations, is_line, label};
use crate::kernel::{Binding, Variant};
use crate::link::Library;

/// When lanes of a subgroup that took different branches reconverge. Without a promise a driver may keep them
/// apart for as long as it likes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reconvergence {
    /// As soon as the source says (VK_KHR_shader_maximal_reconvergence).
    Maximal,
    /// Where a branch ends that the whole subgroup came to together (VK_KHR_shader_subgroup_uniform_control_flow).
    UniformControlFlow,
}

/// What a driver promises a kernel that asks for it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Promises {
    /// Of lanes that diverged.
    pub reconvergence: Option<Reconvergence>,
    /// Infinities, NaN and the signs of zeros are preserved: the driver does not assume that there are none.
    pub special_values: bool,
    /// Floats are rounded to nearest, ties to even.
    pub nearest_rounding: bool,
    /// Subnormal floats are zeros.
    pub flushes_subnormals: bool,
}

/// What a kernel is built for.
#[derive(Debug, Clone, Copy)]
pub struct Build<'a> {
    /// Specialization constants by id.
    pub constants: &'a [u32],
    /// How it computes with floats.
    pub arithmetic: Arithmetic,
    /// Functions that stand for the driver's own operations, for tests of what other drivers do; none otherwise.
    pub driver: Option<&'a Library>,
    /// What the kernel can ask of the driver.
    pub promises: Promises,
}

/// A kernel as it was built.
#[derive(Debug, Clone)]
pub struct Specialized {
    /// SPIR-V words, with the constants still to be set.
    pub words: Vec<u32>,
    /// What it binds, sorted by set and binding.
    pub bindings: Vec<Binding>,
    /// Bytes of push constants that it declares; 0 for none.
    pub push_constant_size: u32,
    /// Instructions of blocks that can run, before the arithmetic is seen to.
    pub instructions: usize,
}

impl Variant {
    /// Takes out what the constants keep from running, and puts the operations of the arithmetic in their places:
    /// functions of `portable`, if it is portable.
    ///
    /// # Panics
    /// When the kernel has an operation of which the library has no form; the build tries every one.
    pub fn specialize(&self, build: &Build<'_>, portable: &Library) -> Specialized {
        let constants = build.constants;
        let mut module = self.module();
        let live = live_blocks(&module, constants);
        let is_live = |block: &Block| live.contains(&label(block));

        let mut used = HashSet::new();
        let mut instructions = 0;
        for block in module.functions.iter().flat_map(|function| &function.blocks).filter(|block| is_live(block)) {
            let code = block.instructions.iter().filter(|i| !is_line(i));
            instructions += code.clone().count();
            used.extend(code.flat_map(|instruction| instruction.operands.iter().filter_map(Operand::id_ref_any)));
        }
        let mut bindings = self.bindings.to_vec();
        for (variable, place) in variables(&module) {
            if !used.contains(&variable) && bindings.iter().any(|binding| (binding.set, binding.binding) == place) {
                bindings.retain(|binding| (binding.set, binding.binding) != place);
                remove(&mut module, variable);
            }
        }
        arithmetic::lower(&mut module, build.arithmetic, portable, build.driver)
            .expect("the build has tried every form");
        ask_for(&mut module, build);
        Specialized { words: module.assemble(), bindings, push_constant_size: self.push_constant_size, instructions }
    }
}

/// Asks the driver for what it promises: that lanes reconverge, in a kernel with subgroup operations, and that floats are
/// what they should be, unless the arithmetic leaves them to the driver.
fn ask_for(module: &mut Module, build: &Build<'_>) {
    let Promises { reconvergence, special_values, nearest_rounding, flushes_subnormals } = build.promises;
    let has = |capability| {
        let is = |i: &Instruction| i.operands.first() == Some(&Operand::Capability(capability));
        module.capabilities.iter().any(is)
    };
    let subgroups = has(Capability::GroupNonUniform);
    let bound = build.arithmetic != Arithmetic::Contracted;
    let entry = module.entry_points[0].operands[1].clone();
    let mut mode = |mode, width: Option<u32>| {
        let operands = [entry.clone(), Operand::ExecutionMode(mode)].into_iter();
        let operands = operands.chain(width.map(Operand::LiteralBit32)).collect();
        module.execution_modes.push(Instruction::new(Op::ExecutionMode, None, None, operands));
    };
    let mut capabilities = Vec::new();
    let mut extension = None;
    match reconvergence {
        Some(Reconvergence::Maximal) if subgroups => {
            mode(ExecutionMode::MaximallyReconvergesKHR, None);
            extension = Some("SPV_KHR_maximal_reconvergence");
        }
        Some(Reconvergence::UniformControlFlow) if subgroups => {
            mode(ExecutionMode::SubgroupUniformControlFlowKHR, None);
            extension = Some("SPV_KHR_subgroup_uniform_control_flow");
        }
        _ => {}
    }
    if special_values && bound {
        mode(ExecutionMode::SignedZeroInfNanPreserve, Some(32));
        capabilities.push(Capability::SignedZeroInfNanPreserve);
    }
    if nearest_rounding && bound {
        mode(ExecutionMode::RoundingModeRTE, Some(32));
        capabilities.push(Capability::RoundingModeRTE);
    }
    if flushes_subnormals && bound {
        mode(ExecutionMode::DenormFlushToZero, Some(32));
        capabilities.push(Capability::DenormFlushToZero);
    }
    let capability = |capability| Instruction::new(Op::Capability, None, None, vec![Operand::Capability(capability)]);
    module.capabilities.extend(capabilities.into_iter().map(capability));
    let name = |name: &str| Instruction::new(Op::Extension, None, None, vec![Operand::LiteralString(name.to_owned())]);
    module.extensions.extend(extension.map(name));
}

/// Variables that are bound, with set and binding.
fn variables(module: &Module) -> Vec<(u32, (u32, u32))> {
    let [sets, places] = [Decoration::DescriptorSet, Decoration::Binding].map(|which| decorations(module, which));
    sets.into_iter().filter_map(|(id, set)| Some((id, (set, *places.get(&id)?)))).collect()
}

/// Labels of the blocks that can run.
///
/// Whole functions at first; what is then known of conditions takes blocks away, and what remains
/// makes more conditions known.
fn live_blocks(module: &Module, constants: &[u32]) -> HashSet<u32> {
    let globals = global_values(module, constants);
    let mut live: HashSet<u32> = module.functions.iter().flat_map(|function| &function.blocks).map(label).collect();
    loop {
        let mut values = globals.clone();
        let mut reached = HashSet::new();
        for function in &module.functions {
            for block in function.blocks.iter().filter(|block| live.contains(&label(block))) {
                for instruction in &block.instructions {
                    if let (Some(id), Some(value)) = (instruction.result_id, evaluate(instruction, &values, &live)) {
                        values.insert(id, value);
                    }
                }
            }
            let blocks: HashMap<u32, &Block> = function.blocks.iter().map(|block| (label(block), block)).collect();
            let mut waiting: Vec<u32> = function.blocks.iter().take(1).map(label).collect();
            while let Some(next) = waiting.pop() {
                if reached.insert(next) {
                    waiting.extend(successors(blocks[&next], &values));
                }
            }
        }
        if reached == live {
            return live;
        }
        live = reached;
    }
}

/// Constants by id: 32-bit words, and booleans as 0 and 1. Those that are not set keep their own value.
fn global_values(module: &Module, constants: &[u32]) -> HashMap<u32, u32> {
    let ids = decorations(module, Decoration::SpecId);
    let mut values = HashMap::new();
    for instruction in &module.types_global_values {
        let Some(id) = instruction.result_id else { continue };
        let set = ids.get(&id).and_then(|place| constants.get(*place as usize)).copied();
        let value = match (instruction.class.opcode, instruction.operands.first()) {
            (Op::ConstantTrue, _) => Some(1),
            (Op::ConstantFalse, _) => Some(0),
            (Op::SpecConstantTrue, _) => Some(set.map_or(1, |value| u32::from(value != 0))),
            (Op::SpecConstantFalse, _) => Some(set.map_or(0, |value| u32::from(value != 0))),
            (Op::Constant, Some(Operand::LiteralBit32(word))) => Some(*word),
            (Op::SpecConstant, Some(Operand::LiteralBit32(word))) => Some(set.unwrap_or(*word)),
            (Op::SpecConstantOp, Some(Operand::LiteralSpecConstantOpInteger(op))) => {
                fold(*op, &known(&instruction.operands[1..], &values))
            }
            _ => None,
        };
        values.extend(value.map(|value| (id, value)));
    }
    values
}

/// The value of each operand, as far as it is known.
fn known(operands: &[Operand], values: &HashMap<u32, u32>) -> Vec<Option<u32>> {
    operands.iter().map(|operand| values.get(&operand.id_ref_any()?).copied()).collect()
}

fn evaluate(instruction: &Instruction, values: &HashMap<u32, u32>, live: &HashSet<u32>) -> Option<u32> {
    if instruction.class.opcode != Op::Phi {
        return fold(instruction.class.opcode, &known(&instruction.operands, values));
    }
    // One value, whichever block came before.
    let pairs = instruction.operands.chunks_exact(2);
    let mut incoming = pairs.filter(|pair| pair[1].id_ref_any().is_some_and(|from| live.contains(&from)));
    let first = values.get(&incoming.next()?[0].id_ref_any()?)?;
    incoming.all(|pair| pair[0].id_ref_any().and_then(|id| values.get(&id)) == Some(first)).then_some(*first)
}

/// The result of an operation on what is known of its operands: the operations that conditions on
/// constants are made of.
fn fold(op: Op, operands: &[Option<u32>]) -> Option<u32> {
    let truth = |value: bool| Some(u32::from(value));
    match (op, operands) {
        (Op::LogicalAnd, [Some(0), _] | [_, Some(0)]) => Some(0),
        (Op::LogicalOr, [Some(1), _] | [_, Some(1)]) => Some(1),
        (Op::LogicalAnd, [Some(a), Some(b)]) => Some(a & b),
        (Op::LogicalOr, [Some(a), Some(b)]) => Some(a | b),
        (Op::LogicalNot, [Some(a)]) => truth(*a == 0),
        (Op::IEqual | Op::LogicalEqual, [Some(a), Some(b)]) => truth(a == b),
        (Op::INotEqual | Op::LogicalNotEqual, [Some(a), Some(b)]) => truth(a != b),
        (Op::UGreaterThan, [Some(a), Some(b)]) => truth(a > b),
        (Op::ULessThan, [Some(a), Some(b)]) => truth(a < b),
        (Op::UGreaterThanEqual, [Some(a), Some(b)]) => truth(a >= b),
        (Op::ULessThanEqual, [Some(a), Some(b)]) => truth(a <= b),
        (Op::Select, [Some(condition), a, b]) => *if *condition != 0 { a } else { b },
        _ => None,
    }
}

/// Blocks that may run after a block.
fn successors(block: &Block, values: &HashMap<u32, u32>) -> Vec<u32> {
    let Some(end) = block.instructions.last() else { return Vec::new() };
    let targets = |operands: &[Operand]| operands.iter().filter_map(Operand::id_ref_any).collect();
    match (end.class.opcode, &end.operands[..]) {
        (Op::BranchConditional, [condition, yes, no, ..]) => {
            match condition.id_ref_any().and_then(|id| values.get(&id)) {
                Some(0) => targets(std::slice::from_ref(no)),
                Some(_) => targets(std::slice::from_ref(yes)),
                None => targets(&[yes.clone(), no.clone()]),
            }
        }
        (Op::Switch, operands) => targets(&operands[1..]),
        (Op::Branch, operands) => targets(operands),
        _ => Vec::new(),
    }
}

/// Removes a variable that no live code uses. The dead code stays, without it: what it read becomes
/// undefined.
fn remove(module: &mut Module, variable: u32) {
    let opaque: HashSet<u32> = module
        .types_global_values
        .iter()
        .filter(|i| matches!(i.class.opcode, Op::TypePointer | Op::TypeImage | Op::TypeSampledImage))
        .filter_map(|i| i.result_id)
        .collect();
    let mut gone = HashSet::from([variable]);
    let names = |i: &Instruction, gone: &HashSet<u32>| {
        i.operands.iter().filter_map(Operand::id_ref_any).any(|id| gone.contains(&id))
    };
    for block in module.functions.iter_mut().flat_map(|function| &mut function.blocks) {
        block.instructions.retain_mut(|instruction| {
            if !names(instruction, &gone) {
                return true;
            }
            let (Some(result), Some(result_type)) = (instruction.result_id, instruction.result_type) else {
                return false;
            };
            if opaque.contains(&result_type) {
                gone.insert(result);
                return false;
            }
            *instruction = Instruction::new(Op::Undef, Some(result_type), Some(result), Vec::new());
            true
        });
    }
    module.types_global_values.retain(|i| i.result_id != Some(variable));
    module.annotations.retain(|i| !names(i, &gone));
    module.debug_names.retain(|i| !names(i, &gone));
    for entry in &mut module.entry_points {
        entry.operands.retain(|operand| operand.id_ref_any() != Some(variable));
    }
}

#[cfg(test)]
mod tests {
    use rspirv::dr::Builder;

    use super::*;
    use crate::reflection::Reflection;
    use crate::small;
    use crate::table::deflate;

    /// A kernel that reads `textures` if `condition`, of two specialization constants, holds, and `hits` in any case.
    fn kernel(condition: impl FnOnce(&mut Builder, [u32; 2], u32) -> u32) -> Variant {
        let mut b = small::builder();
        let [hits, textures] = [("hits", 0), ("textures", 1)].map(|(name, at)| small::buffer(&mut b, name, 0, at));
        let truth = b.type_bool();
        let constants = [0, 1].map(|id| {
            let constant = b.spec_constant_false(truth);
            b.decorate(constant, Decoration::SpecId, [Operand::LiteralBit32(id)]);
            constant
        });
        let uint = b.type_int(32, 0);
        let read = |b: &mut Builder, buffer| {
            let first = small::first_of(b, buffer);
            b.load(uint, None, first, None, []).expect("a block is open");
        };
        small::main(&mut b, |b| {
            read(b, hits);
            let condition = condition(b, constants, truth);
            small::under(b, condition, |b| read(b, textures));
        });
        let module = b.module();
        let reflection = Reflection::of(&module).expect("the host knows all of it");
        let bindings = reflection.bindings.into_iter().map(|binding| {
            let Binding { name, set, binding, kind, reads, writes } = binding;
            Binding { name: &*name.leak(), set, binding, kind, reads, writes }
        });
        let bindings: Vec<Binding> = bindings.collect();
        Variant {
            deflated: deflate(&module.assemble()).leak(),
            fetches_texels: false,
            bindings: bindings.leak(),
            push_constant_size: 0,
        }
    }

    fn specialized(kernel: &Variant, constants: &[u32]) -> Specialized {
        let library = Library::new(small::builder().module());
        let build =
            Build { constants, arithmetic: Arithmetic::Contracted, driver: None, promises: Promises::default() };
        kernel.specialize(&build, &library)
    }

    fn bound(kernel: &Variant, constants: &[u32]) -> Vec<&'static str> {
        specialized(kernel, constants).bindings.iter().map(|binding| binding.name).collect()
    }

    #[test]
    fn what_only_dead_code_uses_is_not_bound() {
        let kernel = kernel(|_, [first, _], _| first);
        assert_eq!(bound(&kernel, &[1, 0]), ["hits", "textures"]);
        assert_eq!(bound(&kernel, &[0, 0]), ["hits"]);
        assert_eq!(bound(&kernel, &[]), ["hits"], "a constant that is not set keeps its own value");
        let [with, without] = [[1, 0], [0, 0]].map(|constants| specialized(&kernel, &constants));
        assert_eq!(with.instructions - without.instructions, 3, "an access, a load and a branch");
        let module = rspirv::dr::load_words(&without.words).expect("it is SPIR-V");
        assert_eq!(variables(&module).len(), 1);
    }

    #[test]
    fn conditions_are_followed_through_logic() {
        let both = kernel(|b, [first, second], truth| {
            let not = b.logical_not(truth, None, first).expect("a block is open");
            b.logical_and(truth, None, not, second).expect("a block is open")
        });
        for (constants, expected) in [([0, 0], 1), ([0, 1], 2), ([1, 0], 1), ([1, 1], 1)] {
            assert_eq!(bound(&both, &constants).len(), expected, "{constants:?}");
        }
    }

    #[test]
    fn what_is_not_known_may_run() {
        let unknown = kernel(|b, _, truth| {
            let uint = b.type_int(32, 0);
            let [zero, one] = [0, 1].map(|value| b.constant_bit32(uint, value));
            // No operation that conditions on constants are made of.
            let sum = b.i_add(uint, None, zero, one).expect("a block is open");
            b.i_equal(truth, None, sum, zero).expect("a block is open")
        });
        assert_eq!(bound(&unknown, &[0, 0]).len(), 2);
    }

    #[test]
    fn promises_are_asked_for_by_kernels_that_need_them() {
        let kernel = kernel(|_, [first, _], _| first);
        let library = Library::new(small::builder().module());
        let promises = Promises {
            reconvergence: Some(Reconvergence::Maximal),
            special_values: true,
            nearest_rounding: true,
            flushes_subnormals: false,
        };
        let modes = |arithmetic| {
            let build = Build { constants: &[], arithmetic, driver: None, promises };
            let words = kernel.specialize(&build, &library).words;
            let module = rspirv::dr::load_words(&words).expect("it is SPIR-V");
            module.execution_modes.iter().map(|mode| mode.operands[1].clone()).collect::<Vec<_>>()
        };
        let asked = [ExecutionMode::SignedZeroInfNanPreserve, ExecutionMode::RoundingModeRTE];
        // Without subgroup operations lanes need not reconverge.
        assert_eq!(modes(Arithmetic::Native), asked.map(Operand::ExecutionMode));
        assert_eq!(modes(Arithmetic::Contracted), []);
    }
}
