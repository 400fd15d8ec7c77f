//! What no kernel may do, found before it runs.

use std::collections::BTreeSet;

use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{BuiltIn, Decoration, Op};

use crate::ids::id_of;

/// Whether a shader, with its includes in it, reads the size of its workgroup before it declares it: the GLSL compiler
/// takes it to be 1 there.
pub fn reads_workgroup_size_too_early(preprocessed: &str) -> bool {
    let Some(read) = preprocessed.find("gl_WorkGroupSize") else { return false };
    preprocessed.find("local_size_x").is_none_or(|declared| declared > read)
}

/// Whether the code counts the invocations of a launch by something else than the specialization constant that holds the
/// size of a workgroup, which has that id: the number of workgroups is of no other use.
pub fn counts_invocations_without_the_constant(module: &Module, workgroup_size_id: u32) -> bool {
    let decorated = |decoration: &[Operand]| {
        let decorates = |i: &&Instruction| i.class.opcode == Op::Decorate && i.operands[1..] == *decoration;
        let ids = module.annotations.iter().filter(decorates).map(|i| id_of(&i.operands[0]));
        ids.collect::<BTreeSet<u32>>()
    };
    let names = |i: &Instruction, ids: &BTreeSet<u32>| {
        i.operands.iter().filter_map(Operand::id_ref_any).any(|id| ids.contains(&id))
    };
    let code = || module.functions.iter().flat_map(|function| function.all_inst_iter());
    let size = [Operand::Decoration(Decoration::SpecId), Operand::LiteralBit32(workgroup_size_id)];
    let mut size = decorated(&size);
    for made in &module.types_global_values {
        if names(made, &size) {
            size.extend(made.result_id);
        }
    }
    let groups = decorated(&[Operand::Decoration(Decoration::BuiltIn), Operand::BuiltIn(BuiltIn::NumWorkgroups)]);
    code().any(|i| names(i, &groups)) && !code().any(|i| names(i, &size))
}

#[cfg(test)]
mod tests {
    use rspirv::dr::Builder;

    use super::*;
    use crate::small::{self, SIZE_ID};

    #[test]
    fn a_workgroup_size_that_is_read_before_it_is_declared_is_found() {
        let declaration = "layout(local_size_x_id = 0) in;\n";
        let read = "uint size() { return gl_WorkGroupSize.x; }\n";
        assert!(reads_workgroup_size_too_early(&format!("{read}{declaration}")));
        assert!(reads_workgroup_size_too_early(read));
        assert!(!reads_workgroup_size_too_early(&format!("{declaration}{read}")));
        assert!(!reads_workgroup_size_too_early(declaration));
    }

    /// A kernel that multiplies the number of workgroups by a size.
    fn counting_kernel(size: impl FnOnce(&mut Builder, u32) -> u32) -> Module {
        let mut b = small::builder();
        let groups = small::builtin(&mut b, BuiltIn::NumWorkgroups);
        let uint = b.type_int(32, 0);
        let vector = b.type_vector(uint, 3);
        let size = size(&mut b, uint);
        small::main(&mut b, |b| {
            let all = b.load(vector, None, groups, None, []).expect("a block is open");
            let count = b.composite_extract(uint, None, all, [0]).expect("a block is open");
            b.i_mul(uint, None, count, size).expect("a block is open");
        });
        b.module()
    }

    #[test]
    fn invocations_are_counted_by_the_hosts_constant_alone() {
        let spec = |id: u32| {
            move |b: &mut Builder, uint: u32| {
                let size = b.spec_constant_bit32(uint, 1);
                b.decorate(size, Decoration::SpecId, [Operand::LiteralBit32(id)]);
                size
            }
        };
        let wrong = |module: &Module| counts_invocations_without_the_constant(module, SIZE_ID);
        assert!(!wrong(&counting_kernel(spec(SIZE_ID))));
        assert!(wrong(&counting_kernel(spec(SIZE_ID + 1))));
        // What the compiler makes of a size that is read before its declaration.
        assert!(wrong(&counting_kernel(|b, uint| b.constant_bit32(uint, 1))));
    }

    #[test]
    fn a_kernel_that_counts_nothing_needs_no_size() {
        let mut b = small::builder();
        small::main(&mut b, |_| {});
        assert!(!counts_invocations_without_the_constant(&b.module(), SIZE_ID));
    }
}
