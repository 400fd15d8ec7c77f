//! Kernels as they are handed to a driver: what their specialization constants leave of them, in an arithmetic. What a
//! kernel costs is known without a driver.

use std::collections::HashSet;

use rspirv::binary::Assemble;
use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{Capability, Decoration, ExecutionMode, Op};

use crate::arithmetic::{self, Arithmetic};
use crate::ids::{decorations, is_line};
use crate::kernel::{Binding, Variant};
use crate::link::Library;
use crate::prune::prune;

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
    /// Instructions that its functions have, before the arithmetic is seen to.
    pub instructions: usize,
}

impl Variant {
    /// Takes out what the constants keep from running, and puts the operations of the arithmetic in their places:
    /// functions of `portable`, if it is portable.
    ///
    /// # Panics
    /// When the kernel has an operation of which the library has no form; the build tries every one.
    pub fn specialize(&self, build: &Build<'_>, portable: &Library) -> Specialized {
        let mut module = self.storage_module();
        prune(&mut module, build.constants);
        self.bring_to_texels(&mut module);
        let code = module.functions.iter().flat_map(|function| &function.blocks).flat_map(|block| &block.instructions);
        let instructions = code.filter(|i| !is_line(i)).count();
        let places = bound_places(&module);
        let bindings = self.bindings.iter().filter(|b| places.contains(&(b.set, b.binding))).copied().collect();
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

/// Set and binding of each variable that is bound.
fn bound_places(module: &Module) -> HashSet<(u32, u32)> {
    let [sets, places] = [Decoration::DescriptorSet, Decoration::Binding].map(|which| decorations(module, which));
    sets.into_iter().filter_map(|(id, set)| Some((set, *places.get(&id)?))).collect()
}

#[cfg(test)]
mod tests {
    use rspirv::dr::Builder;

    use super::*;
    use crate::reflection::Reflection;
    use crate::small;
    use crate::table::deflate;

    /// A kernel that writes `textures` if `condition`, of two specialization constants, holds, and `hits` in any case.
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
        let one = b.constant_bit32(uint, 1);
        let write = |b: &mut Builder, buffer| {
            let first = small::first_of(b, buffer);
            b.store(first, one, None, []).expect("a block is open");
        };
        small::main(&mut b, |b| {
            write(b, hits);
            let condition = condition(b, constants, truth);
            small::under(b, condition, |b| write(b, textures));
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
        assert_eq!(with.instructions - without.instructions, 3, "an access, a store and a branch");
        let module = rspirv::dr::load_words(&without.words).expect("it is SPIR-V");
        assert_eq!(bound_places(&module).len(), 1);
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
