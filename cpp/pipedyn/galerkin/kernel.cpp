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
    .accelerations = run<&Block<double>::accelerations, &Block<Pack>::accelerations>,
    .energy = run<&Block<double>::energy, &Block<Pack>::energy>,
    .power = run<&Block<double>::power, &Block<Pack>::power>,
    .axial = run<&Axial<double>::axial, &Axial<Pack>::axial>,
    .tips = run<&Block<double>::tips, &Block<Pack>::tips>,
    .held = run<&Block<double>::held, &Block<Pack>::held>,
    .jacobian = run<&Linearisation<double>::jacobian, &Linearisation<Pack>::jacobian>,
    .spatial = {.accelerations = spatial_accelerations_of,
                .energy = spatial_energy_of,
                .power = spatial_power_of,
                .tips = spatial_tips_of,
                .jacobian = spatial_jacobian_of},
    .operators = ::operators,
};

}  // namespace pipedyn
