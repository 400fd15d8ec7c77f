//! What the host must know of a kernel, read from its SPIR-V.

use std::collections::HashMap;

use rspirv::dr::{Instruction, Module, Operand};
use rspirv::spirv::{Decoration, Op, StorageClass};

use crate::ids::{decorations, id_of, names};
use crate::kernel::{Binding, BindingKind, Member, StructLayout};

/// The layout of a struct, as it was read.
pub type Layout = StructLayout<String, Vec<Member<String>>>;

/// What a kernel asks of the host.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reflection {
    /// What it binds, sorted by set and binding.
    pub bindings: Vec<Binding<String>>,
    /// Bytes of push constants that it declares; 0 for none.
    pub push_constant_size: u32,
    /// Every struct and block whose members have offsets, in the order of their declarations.
    pub structs: Vec<Layout>,
}

impl Reflection {
    /// Of a module that still has its names.
    ///
    /// # Errors
    /// When it binds something, or uses a buffer, in a way that the host has no word for.
    pub fn of(module: &Module) -> Result<Self, String> {
        Reader::of(module).reflection()
    }
}

struct Reader<'a> {
    module: &'a Module,
    names: HashMap<u32, String>,
    /// Types and global values by id.
    definitions: HashMap<u32, &'a Instruction>,
    sets: HashMap<u32, u32>,
    bindings: HashMap<u32, u32>,
    strides: HashMap<u32, u32>,
    /// By type and member.
    offsets: HashMap<(u32, u32), u32>,
    member_names: HashMap<(u32, u32), &'a str>,
}

impl<'a> Reader<'a> {
    fn of(module: &'a Module) -> Self {
        let definitions = module.types_global_values.iter().filter_map(|i| Some((i.result_id?, i))).collect();
        let offset = |i: &Instruction| match i.operands[..] {
            [
                Operand::IdRef(id),
                Operand::LiteralBit32(member),
                Operand::Decoration(Decoration::Offset),
                Operand::LiteralBit32(offset),
            ] => Some(((id, member), offset)),
            _ => None,
        };
        let member_name = |i: &'a Instruction| match &i.operands[..] {
            [Operand::IdRef(id), Operand::LiteralBit32(member), Operand::LiteralString(name)] => {
                Some(((*id, *member), name.as_str()))
            }
            _ => None,
        };
        Self {
            module,
            names: names(module),
            definitions,
            sets: decorations(module, Decoration::DescriptorSet),
            bindings: decorations(module, Decoration::Binding),
            strides: decorations(module, Decoration::ArrayStride),
            offsets: module.annotations.iter().filter_map(offset).collect(),
            member_names: module.debug_names.iter().filter_map(member_name).collect(),
        }
    }

    fn reflection(&self) -> Result<Reflection, String> {
        let mut bindings = Vec::new();
        let mut push_constant_size = 0;
        for variable in self.module.types_global_values.iter().filter(|i| i.class.opcode == Op::Variable) {
            let id = variable.result_id.expect("a variable has an id");
            let Operand::StorageClass(class) = variable.operands[0] else { continue };
            let pointer = self.definition(variable.result_type.expect("a variable has a type"));
            let pointee = id_of(&pointer.operands[1]);
            if class == StorageClass::PushConstant {
                push_constant_size = self.size(pointee)?;
            }
            let (Some(&set), Some(&binding)) = (self.sets.get(&id), self.bindings.get(&id)) else { continue };
            let name = self.name(id);
            let kind = match (class, self.definition(pointee).class.opcode) {
                (StorageClass::Uniform, _) => BindingKind::UniformBuffer,
                (StorageClass::StorageBuffer, _) => BindingKind::StorageBuffer,
                (StorageClass::UniformConstant, Op::TypeSampledImage) => BindingKind::UniformTexelBuffer,
                (class, op) => return Err(format!("{name} binds {class:?} of {op:?}, which the host does not know")),
            };
            let (reads, writes) = self.accesses(id).map_err(|op| {
                format!("{name} is used by {op:?}, of which the host does not know whether it reads or writes")
            })?;
            bindings.push(Binding { name, set, binding, kind, reads, writes });
        }
        bindings.sort_by_key(|binding| (binding.set, binding.binding));
        Ok(Reflection { bindings, push_constant_size, structs: self.structs()? })
    }

    fn definition(&self, id: u32) -> &'a Instruction {
        self.definitions.get(&id).expect("SPIR-V defines each type that it names")
    }

    fn name(&self, id: u32) -> String {
        self.names.get(&id).cloned().unwrap_or_default()
    }

    /// Whether the code reads and writes the variable, through whatever pointer.
    fn accesses(&self, variable: u32) -> Result<(bool, bool), Op> {
        let mut pointers = vec![variable];
        let (mut reads, mut writes) = (false, false);
        for instruction in self.module.functions.iter().flat_map(|function| function.all_inst_iter()) {
            let Some(Operand::IdRef(first)) = instruction.operands.first() else { continue };
            if !pointers.contains(first) {
                continue;
            }
            match instruction.class.opcode {
                Op::AccessChain | Op::InBoundsAccessChain | Op::CopyObject => pointers.extend(instruction.result_id),
                Op::Load => reads = true,
                Op::Store => writes = true,
                Op::AtomicIAdd | Op::AtomicOr | Op::AtomicUMax | Op::AtomicUMin => (reads, writes) = (true, true),
                other => return Err(other),
            }
        }
        Ok((reads, writes))
    }

    /// Bytes that a type takes up, by its explicit offsets and strides; 0 for a runtime array.
    fn size(&self, id: u32) -> Result<u32, String> {
        let of = self.definition(id);
        let literal = |operand: &Operand| match operand {
            Operand::LiteralBit32(value) => *value,
            _ => unreachable!("types have literals there"),
        };
        Ok(match of.class.opcode {
            Op::TypeInt | Op::TypeFloat => literal(&of.operands[0]) / 8,
            Op::TypeVector => self.size(id_of(&of.operands[0]))? * literal(&of.operands[1]),
            Op::TypeStruct => {
                let mut end = 0;
                for (member, member_type) in (0..).zip(&of.operands) {
                    let offset = self.offsets.get(&(id, member)).copied().unwrap_or(0);
                    end = end.max(offset + self.size(id_of(member_type))?);
                }
                end
            }
            Op::TypeArray => {
                let length = self.definition(id_of(&of.operands[1]));
                self.strides.get(&id).copied().unwrap_or(0) * literal(&length.operands[0])
            }
            Op::TypeRuntimeArray => 0,
            other => return Err(format!("a block has a member of {other:?}, whose layout the host does not know")),
        })
    }

    fn structs(&self) -> Result<Vec<Layout>, String> {
        let mut layouts = Vec::new();
        for of in self.module.types_global_values.iter().filter(|i| i.class.opcode == Op::TypeStruct) {
            let id = of.result_id.expect("a type has an id");
            if !self.offsets.contains_key(&(id, 0)) {
                continue;
            }
            let mut members = Vec::new();
            for (member, member_type) in (0..).zip(&of.operands) {
                let member_type = id_of(member_type);
                members.push(Member {
                    name: self.member_names.get(&(id, member)).copied().unwrap_or_default().to_owned(),
                    offset: *self.offsets.get(&(id, member)).expect("every member of a laid-out struct has an offset"),
                    size: self.size(member_type)?,
                    array_stride: self.strides.get(&member_type).copied().unwrap_or(0),
                });
            }
            layouts.push(StructLayout { name: self.name(id), members });
        }
        Ok(layouts)
    }
}

#[cfg(test)]
mod tests {
    use rspirv::dr::Builder;

    use super::*;
    use crate::small;

    /// The module of an entry point over two buffers.
    fn over_two(code: impl FnOnce(&mut Builder, [u32; 2])) -> Module {
        let mut b = small::builder();
        let buffers = [small::buffer(&mut b, "hits", 1, 3), small::buffer(&mut b, "rays", 0, 2)];
        small::main(&mut b, |b| code(b, buffers));
        b.module()
    }

    #[test]
    fn what_is_read_and_written_is_seen_through_pointers() {
        let module = over_two(|b, [hits, rays]| {
            let uint = b.type_int(32, 0);
            let from = small::first_of(b, rays);
            let value = b.load(uint, None, from, None, []).expect("a block is open");
            let to = small::first_of(b, hits);
            b.store(to, value, None, []).expect("a block is open");
        });
        let reflection = Reflection::of(&module).expect("the host knows all of it");
        let [rays, hits] = &reflection.bindings[..] else { panic!("two buffers are bound") };
        assert_eq!((rays.name.as_str(), rays.set, rays.binding, rays.reads, rays.writes), ("rays", 0, 2, true, false));
        assert_eq!((hits.name.as_str(), hits.set, hits.binding, hits.reads, hits.writes), ("hits", 1, 3, false, true));
        assert_eq!(hits.kind, BindingKind::StorageBuffer);
        assert_eq!(reflection.push_constant_size, 0);
    }

    #[test]
    fn layouts_have_names_offsets_sizes_and_strides() {
        let module = over_two(|_, _| {});
        let reflection = Reflection::of(&module).expect("the host knows all of it");
        let first = Member { name: "first".to_owned(), offset: 0, size: 4, array_stride: 0 };
        let rest = Member { name: "rest".to_owned(), offset: 4, size: 0, array_stride: 4 };
        assert_eq!(reflection.structs[0], StructLayout { name: "hitsBlock".to_owned(), members: vec![first, rest] });
    }

    #[test]
    fn a_use_that_the_host_does_not_know_is_an_error() {
        let module = over_two(|b, [hits, _]| {
            let uint = b.type_int(32, 0);
            b.array_length(uint, None, hits, 1).expect("a block is open");
        });
        let error = Reflection::of(&module).expect_err("a length is neither read nor written");
        assert!(error.contains("hits is used by ArrayLength"), "{error}");
    }
}
