// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <string>
#include <vector>

namespace pipedyn {

/// A law of force with its numbers, as a pipe stores it.
struct Term {
  int law = 0;          // row in the table of laws.hpp
  double at = 0.0;      // arc length, 0 < at <= 1; the mean of all if the law acts all along
  double numbers[9]{};  // numbers of the law, in the order in which its header reads them
};

using Terms = std::vector<Term>;

/// Makes the term of the law with this name. Throws std::invalid_argument unless laws.hpp has the
/// name, at lies in (0, 1] if the law acts at one place, and there are at most nine numbers.
Term make_term(const std::string& law, double at, const std::vector<double>& numbers);

/// Whether any of the terms resists small velocities of the straight pipe.
bool resist(const Terms& terms);

/// Stiffness, >= 0, that terms add to the straight pipe, against displacement across it and against
/// rotation, each summed over all terms.
std::array<double, 2> added_stiffness(const Terms& terms);

/// Whether a law, named as for make_term, acts in small motions about the straight pipe.
bool is_felt_by_small_motions(const std::string& law);

}  // namespace pipedyn
