// SPDX-License-Identifier: MIT
//
// The functions of the reduced model for one level. Compiled once for each level, like
// chain/motion.cpp.
#include "pipedyn/galerkin/kernel.hpp"

#include "pipedyn/galerkin/axial.hpp"
#include "pipedyn/galerkin/block.hpp"
#include "pipedyn/galerkin/linearisation.hpp"
#include "pipedyn/galerkin/space.hpp"

namespace {

/// Calls a function of a block, with scratch memory for its arrays.
template <class Of>
void call(void (Of::*compute)(const Batch&, double*), const GridTables& grid,
          const MotionEffects& effects, const Batch& batch, double* out) {
  Of block(grid, effects);
  laid_out([&](Layout& layout) { block.take(layout); });
  (block.*compute)(batch, out);
}

/// Calls a function of the block for a batch: of one member or of as many as a pack holds.
template <auto alone, auto side_by_side>
void run(const GridTables& grid, const MotionEffects& effects, const Batch& batch, double* out) {
  if (batch.members == 1) {
    call(alone, grid, effects, batch, out);
  } else {
    call(side_by_side, grid, effects, batch, out);
  }
}

void operators(const GridTables& grid, const MotionEffects& effects, const Batch& batch,
               const double* displacements, double* out) {
  Linearisation<double> block(grid, effects);
  laid_out([&](Layout& layout) { block.take(layout); });
  block.operators(batch, displacements, out);
}

}  // namespace

namespace pipedyn {

const GalerkinKernel PIPEDYN_NAMED(galerkin) = {
    .planar = {.accelerations = run<&Block<double>::accelerations, &Block<Pack>::accelerations>,
               .energy = run<&Block<double>::energy, &Block<Pack>::energy>,
               .power = run<&Block<double>::power, &Block<Pack>::power>,
               .tips = run<&Block<double>::tips, &Block<Pack>::tips>,
               .jacobian = run<&Linearisation<double>::jacobian, &Linearisation<Pack>::jacobian>},
    .spatial = {.accelerations = in_space<[](auto& of, const auto& set) { of.accelerations(set); }>,
                .energy = in_space<[](auto& of, const auto& set) { set(0, of.energy()); }>,
                .power = in_space<[](auto& of, const auto& set) { of.powers(set); }>,
                .tips = in_space<[](auto& of, const auto& set) { of.tips(set); }>,
                .jacobian = jacobian_in_space},
    .axial = run<&Axial<double>::axial, &Axial<Pack>::axial>,
    .held = run<&Block<double>::held, &Block<Pack>::held>,
    .operators = ::operators,
};

}  // namespace pipedyn
