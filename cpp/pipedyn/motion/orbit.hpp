// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <vector>

namespace pipedyn {

/// Products of the maps x -> T x + r of intervals, given as [T | r] (count, n, columns). The
/// intervals are divided into runs; out receives for each interval the product [P | R] of all maps
/// from the beginning of its run to its own end (count, n, columns). A run ends before an entry of
/// P reaches most. Returns the beginnings of the runs.
std::vector<std::ptrdiff_t> carry_maps(const double* maps, std::ptrdiff_t count, std::ptrdiff_t n,
                                       std::ptrdiff_t columns, double most, double* out);

}  // namespace pipedyn
