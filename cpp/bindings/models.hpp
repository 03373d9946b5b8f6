// SPDX-License-Identifier: MIT
// What the bindings share that take a compiled model of any kind.
#pragma once

#include "arguments.hpp"
#include "pipedyn/chain/spatial_chain.hpp"
#include "pipedyn/galerkin/galerkin.hpp"
#include "pipedyn/modular/scene.hpp"

namespace pipedyn {

/// Calls `what` with the compiled model. Throws a TypeError if `of` is none.
template <class What>
void with_compiled(const py::object& of, const What& what) {
  if (py::isinstance<Galerkin>(of)) return what(of.cast<const Galerkin&>());
  if (py::isinstance<SpatialGalerkin>(of)) return what(of.cast<const SpatialGalerkin&>());
  if (py::isinstance<SpatialChain>(of)) return what(of.cast<const SpatialChain&>());
  what(of.cast<const Scene&>());
}

}  // namespace pipedyn
