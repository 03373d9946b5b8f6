// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <string>
#include <vector>

namespace pipedyn {

/// A law of force with its numbers, as the pipe holds it.
struct Term {
  int law = 0;          // place in the table of laws.hpp
  double at = 0.0;      // arc length, 0 < at <= 1; not read where the law acts all along
  double numbers[3]{};  // the law's own, as its header reads them
};

using Terms = std::vector<Term>;

/// The term of a law by its name. Throws std::invalid_argument unless laws.hpp has the name, at
/// lies in (0, 1] where the law acts at one place, and there are at most three numbers.
Term make_term(const std::string& law, double at, const std::vector<double>& numbers);

/// Whether one of them resists small velocities of the straight pipe.
bool resist(const Terms& terms);

/// What terms add to the stiffness of the straight pipe, summed over their places or along it: by
/// displacement across and by rotation.
std::array<double, 2> added_stiffness(const Terms& terms);

/// Whether small motions about the straight pipe feel a law, named as for make_term.
bool is_felt_by_small_motions(const std::string& law);

}  // namespace pipedyn
