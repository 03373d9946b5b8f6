// SPDX-License-Identifier: MIT
#include "pipedyn/enforcement.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <utility>

namespace pipedyn {

namespace {

/// A row of constraints this small against its coefficients says nothing new.
constexpr double redundant = 1e-10;
/// A living coordinate that sees a variable this little does not see it.
constexpr double unseen = 1e-15;
/// An inertia this small against the front's is none, both as square roots.
constexpr double massless = 1e-13;
/// Of squares; what is left of rounding after many stages would underflow.
constexpr double nothing = 1e-200;

}  // namespace

// ------------------------------------------------------------------------------------ symbolic

Enforcement::Enforcement(std::vector<double> scale, std::vector<InertiaRow> inertia,
                         std::vector<Group> groups)
    : scale_(std::move(scale)), inertia_(std::move(inertia)), groups_(std::move(groups)) {
  const int coordinates = static_cast<int>(scale_.size());
  std::vector<char> touched(scale_.size(), 0);
  for (const InertiaRow& row : inertia_) {
    for (const int c : row.coordinate) touched[static_cast<std::size_t>(c)] = 1;
  }
  std::size_t entries = 0, rows = 0;
  for (const Group& group : groups_) {
    matrix_start_.push_back(entries);
    row_start_.push_back(rows);
    entries += group.coordinate.size() * static_cast<std::size_t>(group.rows);
    rows += static_cast<std::size_t>(group.rows);
    for (const int c : group.coordinate) touched[static_cast<std::size_t>(c)] = 1;
  }
  for (int c = 0; c < coordinates; ++c) {
    if (!touched[static_cast<std::size_t>(c)]) inertia_.push_back({{c}, {0.0}});
  }

  struct Item {
    int key;
    bool constraint;
    int index;
  };
  // Three coordinates a node: the key is the largest node, and its inertia precedes its groups.
  std::vector<Item> items;
  const auto key = [](const std::vector<int>& touches) {
    return touches.empty() ? -1 : *std::max_element(touches.begin(), touches.end()) / 3;
  };
  for (std::size_t i = 0; i < inertia_.size(); ++i) {
    items.push_back({key(inertia_[i].coordinate), false, static_cast<int>(i)});
  }
  for (std::size_t i = 0; i < groups_.size(); ++i) {
    items.push_back({key(groups_[i].coordinate), true, static_cast<int>(i)});
  }
  std::stable_sort(items.begin(), items.end(), [](const Item& a, const Item& b) {
    return a.key != b.key ? a.key > b.key : !a.constraint && b.constraint;
  });
  const auto touches = [&](const Item& item) -> const std::vector<int>& {
    const auto i = static_cast<std::size_t>(item.index);
    return item.constraint ? groups_[i].coordinate : inertia_[i].coordinate;
  };

  std::vector<std::size_t> last(scale_.size(), 0);
  for (std::size_t i = 0; i < items.size(); ++i) {
    for (const int c : touches(items[i])) last[static_cast<std::size_t>(c)] = i;
  }
  std::vector<int> slot_of(scale_.size(), -1);
  std::vector<int> living;  // coordinates that survive the last stage
  Stage stage;
  const auto begin = [&] {
    stage = Stage{};
    stage.coordinate = living;
    for (std::size_t s = 0; s < living.size(); ++s) {
      slot_of[static_cast<std::size_t>(living[s])] = static_cast<int>(s);
    }
  };
  begin();
  for (std::size_t i = 0; i < items.size(); ++i) {
    Element element{items[i].constraint, items[i].index, {}};
    bool deaths = false;
    for (const int c : touches(items[i])) {
      int& slot = slot_of[static_cast<std::size_t>(c)];
      if (slot < 0) {
        slot = static_cast<int>(stage.coordinate.size());
        stage.coordinate.push_back(c);
        stage.entering.push_back(c);
      }
      element.slot.push_back(slot);
      deaths = deaths || last[static_cast<std::size_t>(c)] == i;
    }
    if (element.constraint) {
      const int count = groups_[static_cast<std::size_t>(element.index)].rows;
      stage.group_rows = std::max(stage.group_rows, count);
    } else {
      ++stage.inertia_rows;
    }
    stage.elements.push_back(std::move(element));
    if (!deaths && i + 1 < items.size()) continue;

    const std::size_t before = living.size();
    living.clear();
    for (std::size_t s = 0; s < stage.coordinate.size(); ++s) {
      const int c = stage.coordinate[s];
      if (last[static_cast<std::size_t>(c)] <= i) {
        stage.dying.push_back(static_cast<int>(s));
      } else {
        stage.surviving.push_back(static_cast<int>(s));
        living.push_back(c);
      }
    }
    const int variables = static_cast<int>(stage.coordinate.size());
    most_variables_ = std::max(most_variables_, variables);
    most_rows_ = std::max(most_rows_, 1 + variables + static_cast<int>(before) + stage.group_rows +
                                          static_cast<int>(before) + stage.inertia_rows);
    record_size_ += (before + stage.dying.size()) * (living.size() + 1);
    stages_.push_back(std::move(stage));
    begin();
  }
}

// ------------------------------------------------------------------------------------- numeric

/// Everything that is affine in the front's variables, one a row: the force g (its constant is of
/// no use), the slots' coordinates L z + p, the variables with which the stage began, the rows of
/// the group being enforced, and the energy's R z + r. One variable a column.
class Enforcement::Front {
 public:
  Front(int most_rows, int most_variables, double* memory)
      : stride_(most_rows), data_(memory), constant_(memory + most_rows * most_variables) {
    product_ = constant_ + most_rows;
    reflection_ = product_ + most_rows;
  }
  static std::size_t size(int most_rows, int most_variables) {
    return static_cast<std::size_t>(most_rows) * static_cast<std::size_t>(most_variables + 2) +
           static_cast<std::size_t>(std::max(most_rows, most_variables));
  }

  int variables = 0;
  int energy_rows = 0;  // R's
  int slots = 0, began = 0;

  int slot_row(int slot) const { return 1 + slot; }
  int began_row() const { return 1 + slots; }
  int group_row() const { return 1 + slots + began; }
  int energy_row() const { return energy_first_; }
  int end_row() const { return energy_first_ + energy_rows; }

  double& at(int row, int variable) { return column(variable)[row]; }
  double& constant(int row) { return constant_[row]; }
  double* column(int variable) { return data_ + variable * stride_; }
  double* constants() { return constant_; }

  /// The stage's rows, all zero but what carries over from the previous stage's front.
  void begin(const Stage& stage, Front& previous, const std::vector<int>& survivors) {
    slots = static_cast<int>(stage.coordinate.size());
    began = previous.variables;
    const int entering = static_cast<int>(stage.entering.size());
    variables = began + entering;
    energy_first_ = 1 + slots + began + stage.group_rows;
    energy_rows = previous.energy_rows;
    const std::size_t bytes = sizeof(double) * static_cast<std::size_t>(end_row());
    for (int v = 0; v <= variables; ++v) {
      double* const to = v < variables ? column(v) : constant_;
      std::memset(to, 0, bytes);
      if (v >= began && v < variables) continue;
      const double* const from = v < began ? previous.column(v) : previous.constant_;
      to[0] = v < began ? from[0] : 0.0;
      for (std::size_t s = 0; s < survivors.size(); ++s) {
        to[1 + static_cast<int>(s)] = from[previous.slot_row(survivors[s])];
      }
      if (v < began) to[began_row() + v] = 1.0;
      std::copy_n(from + previous.energy_row(), energy_rows, to + energy_first_);
    }
  }

  void append_energy_row() {
    const int row = end_row();
    ++energy_rows;
    for (int v = 0; v < variables; ++v) at(row, v) = 0.0;
    constant_[row] = 0.0;
  }

  double norm(int row, int first) const {
    double sum = 0.0;
    for (int v = first; v < variables; ++v) {
      const double x = data_[v * stride_ + row];
      sum += x * x;
    }
    return std::sqrt(sum);
  }

  /// Orthogonal change of the variables from `first` on after which the row sees only `pivot`.
  void reflect(int row, int first, int pivot, double norm) {
    const int end = end_row();
    const double at_pivot = at(row, pivot);
    const double image = at_pivot > 0.0 ? -norm : norm;
    for (int v = first; v < variables; ++v) reflection_[v] = at(row, v);
    reflection_[pivot] -= image;
    const double factor = 1.0 / (norm * (norm + std::abs(at_pivot)));
    std::fill_n(product_, end, 0.0);
    for (int v = first; v < variables; ++v) {
      const double* const c = column(v);
      const double weight = reflection_[v];
      for (int i = 0; i < end; ++i) product_[i] += weight * c[i];
    }
    for (int v = first; v < variables; ++v) {
      double* const c = column(v);
      const double weight = factor * reflection_[v];
      for (int i = 0; i < end; ++i) c[i] -= weight * product_[i];
      c[row] = 0.0;
    }
    at(row, pivot) = image;
  }

  /// The last variable takes the given value.
  void fix_last(double value) {
    const double* const c = column(variables - 1);
    const int end = end_row();
    for (int i = 0; i < end; ++i) constant_[i] += value * c[i];
    --variables;
  }

  double energy_norm(int variable) {
    const double* const c = column(variable) + energy_first_;
    double sum = 0.0;
    for (int i = 0; i < energy_rows; ++i) sum += c[i] * c[i];
    return std::sqrt(sum);
  }

  /// Reflection of the energy's rows from `first` on (counted within them) after which the variable
  /// enters only that row; applied to variables [0, columns) and the constant.
  void reflect_energy(int variable, int first, int columns) {
    double* const x = column(variable) + energy_first_;
    const int rows = energy_rows;
    int largest = first;
    double sum = 0.0;
    for (int i = first; i < rows; ++i) {
      sum += x[i] * x[i];
      if (std::abs(x[i]) > std::abs(x[largest])) largest = i;
    }
    if (sum < nothing) {
      std::fill(x + first, x + rows, 0.0);
      return;
    }
    if (largest != first) {
      for (int v = 0; v < variables; ++v) {
        std::swap(column(v)[energy_first_ + first], column(v)[energy_first_ + largest]);
      }
      std::swap(constant_[energy_first_ + first], constant_[energy_first_ + largest]);
    }
    const double norm = std::sqrt(sum);
    const double image = x[first] > 0.0 ? -norm : norm;
    const double factor = 1.0 / (norm * (norm + std::abs(x[first])));
    for (int i = first; i < rows; ++i) reflection_[i] = x[i];
    reflection_[first] -= image;
    for (int v = 0; v <= columns; ++v) {
      if (v == variable && v < columns) continue;
      double* const c = (v < columns ? column(v) : constant_) + energy_first_;
      double product = 0.0;
      for (int i = first; i < rows; ++i) product += reflection_[i] * c[i];
      product *= factor;
      for (int i = first; i < rows; ++i) c[i] -= product * reflection_[i];
    }
    std::fill(x + first, x + rows, 0.0);
    x[first] = image;
  }

  void swap_variables(int a, int b) {
    if (a != b) std::swap_ranges(column(a), column(a) + end_row(), column(b));
  }

  void drop_first_energy_row() {
    ++energy_first_;
    --energy_rows;
  }

  /// As many of the energy's rows as variables say all.
  void compress() {
    if (energy_rows <= variables) return;
    unsigned long long used = 0;  // by position, for fronts of usual size
    std::vector<char> many(variables > 64 ? static_cast<std::size_t>(variables) : 0, 0);
    for (int first = 0; first < variables; ++first) {
      int best = -1;
      double most = -1.0;
      for (int v = 0; v < variables; ++v) {
        if (many.empty() ? (used >> v & 1U) != 0 : many[static_cast<std::size_t>(v)] != 0) continue;
        const double* const c = column(v) + energy_first_;
        double sum = 0.0;
        for (int i = first; i < energy_rows; ++i) sum += c[i] * c[i];
        if (sum > most) {
          most = sum;
          best = v;
        }
      }
      if (many.empty()) {
        used |= 1ULL << best;
      } else {
        many[static_cast<std::size_t>(best)] = 1;
      }
      reflect_energy(best, first, variables);
    }
    energy_rows = variables;
  }

 private:
  int stride_;
  double* data_;
  double* constant_;
  double* product_;
  double* reflection_;
  int energy_first_ = 1;
};

namespace {

double* thread_memory(std::size_t count) {
  thread_local std::vector<double> kept;
  if (kept.size() < count) kept = std::vector<double>(count);
  return kept.data();
}

struct Record {
  const double* values;  // column-major (began + dying, variables), then the constants
  int began, dying, variables;
};

}  // namespace

int Enforcement::solve(const double* matrix, const double* b, const double* force,
                       double* accelerations) const {
  const std::size_t front_size = Front::size(most_rows_, most_variables_);
  double* const memory =
      thread_memory(2 * front_size + record_size_ + 2 * static_cast<std::size_t>(most_variables_));
  Front fronts[2] = {{most_rows_, most_variables_, memory},
                     {most_rows_, most_variables_, memory + front_size}};
  double* record = memory + 2 * front_size;
  double* const before = record + record_size_;
  double* const after = before + most_variables_;
  thread_local std::vector<Record> records;
  records.clear();

  // What is known of the front's last variables: their values z, to all that came before.
  const auto substitute = [&](double* z, double* next, double scale, auto&& found) {
    for (std::size_t s = records.size(); s-- > 0;) {
      const Record& r = records[s];
      const int rows = r.began + r.dying;
      for (int i = 0; i < rows; ++i) {
        double sum = scale * r.values[r.variables * rows + i];
        for (int v = 0; v < r.variables; ++v) sum += r.values[v * rows + i] * z[v];
        if (i < r.began) {
          next[i] = sum;
        } else {
          const Stage& stage = stages_[s];
          const int slot = stage.dying[static_cast<std::size_t>(i - r.began)];
          found(stage.coordinate[static_cast<std::size_t>(slot)], sum);
        }
      }
      std::swap(z, next);
    }
  };

  static const std::vector<int> none;
  for (std::size_t s = 0; s < stages_.size(); ++s) {
    const Stage& stage = stages_[s];
    Front& front = fronts[s % 2];
    front.begin(stage, fronts[(s + 1) % 2], s > 0 ? stages_[s - 1].surviving : none);
    const int kept = front.slots - static_cast<int>(stage.entering.size());
    for (std::size_t e = 0; e < stage.entering.size(); ++e) {
      const int variable = front.began + static_cast<int>(e);
      const auto c = static_cast<std::size_t>(stage.entering[e]);
      front.at(front.slot_row(kept + static_cast<int>(e)), variable) = scale_[c];
      front.at(0, variable) = scale_[c] * force[c];
    }

    for (const Element& element : stage.elements) {
      const auto index = static_cast<std::size_t>(element.index);
      const std::size_t touched = element.slot.size();
      if (!element.constraint) {
        const InertiaRow& inertia = inertia_[index];
        const int row = front.end_row();
        front.append_energy_row();
        for (int v = 0; v <= front.variables; ++v) {
          double* const c = v < front.variables ? front.column(v) : front.constants();
          double sum = 0.0;
          for (std::size_t i = 0; i < touched; ++i) {
            sum += inertia.weight[i] * c[front.slot_row(element.slot[i])];
          }
          c[row] = sum;
        }
        continue;
      }
      const int rows = groups_[index].rows;
      const double* const a = matrix + matrix_start_[index];
      const int first = front.group_row();
      for (int r = 0; r < rows; ++r) {
        const double* const entries = a + static_cast<std::size_t>(r) * touched;
        double size = 0.0;
        for (std::size_t i = 0; i < touched; ++i) {
          const auto slot = static_cast<std::size_t>(element.slot[i]);
          const double entry =
              entries[i] * scale_[static_cast<std::size_t>(stage.coordinate[slot])];
          size += entry * entry;
        }
        const double weight = size > 0.0 ? 1.0 / std::sqrt(size) : 0.0;
        for (int v = 0; v <= front.variables; ++v) {
          double* const c = v < front.variables ? front.column(v) : front.constants();
          double sum = 0.0;
          for (std::size_t i = 0; i < touched; ++i) {
            sum += entries[i] * c[front.slot_row(element.slot[i])];
          }
          c[first + r] = weight * sum;
        }
        front.constant(first + r) -= weight * b[row_start_[index] + static_cast<std::size_t>(r)];
      }
      for (int done = 0; done < rows; ++done) {
        int best = -1;
        double most = redundant;
        for (int r = 0; r < rows; ++r) {
          const double norm = front.norm(first + r, 0);
          if (norm > most) {
            most = norm;
            best = r;
          }
        }
        if (best < 0) break;
        front.reflect(first + best, 0, front.variables - 1, most);
        const double value =
            -front.constant(first + best) / front.at(first + best, front.variables - 1);
        front.fix_last(value);
      }
    }

    int seen = 0;
    while (seen < front.variables) {
      int best = -1;
      double most = unseen;
      for (const int slot : stage.surviving) {
        const double weight =
            scale_[static_cast<std::size_t>(stage.coordinate[static_cast<std::size_t>(slot)])];
        const double norm = front.norm(front.slot_row(slot), seen) / weight;
        if (norm > most) {
          most = norm;
          best = slot;
        }
      }
      if (best < 0) break;
      const int row = front.slot_row(best);
      front.reflect(row, seen, seen, front.norm(row, seen));
      ++seen;
    }
    double largest = 0.0;
    for (int v = 0; v < front.variables; ++v) largest = std::max(largest, front.energy_norm(v));
    while (front.variables > seen) {
      int best = seen;
      double most = -1.0;
      for (int v = seen; v < front.variables; ++v) {
        const double norm = front.energy_norm(v);
        if (norm > most) {
          most = norm;
          best = v;
        }
      }
      const int w = front.variables - 1;
      front.swap_variables(best, w);
      const int dying = static_cast<int>(stage.dying.size());
      if (!(most > massless * largest)) {
        for (int i = 0; i < front.began; ++i) before[i] = front.at(front.began_row() + i, w);
        int coordinate = 0;
        double size = -1.0;
        const auto found = [&](int c, double value) {
          const double moves = std::abs(value) / scale_[static_cast<std::size_t>(c)];
          if (moves > size) {
            size = moves;
            coordinate = c;
          }
        };
        for (int i = 0; i < dying; ++i) {
          const int slot = stage.dying[static_cast<std::size_t>(i)];
          found(stage.coordinate[static_cast<std::size_t>(slot)],
                front.at(front.slot_row(slot), w));
        }
        substitute(before, after, 0.0, found);
        return coordinate;
      }
      front.reflect_energy(w, 0, w);
      const int top = front.energy_row();
      const double t = front.at(top, w);
      const double push = front.at(0, w) / t;
      const double constant = (push - front.constant(top)) / t;
      const auto eliminate = [&](int row) {
        const double entry = front.at(row, w);
        if (entry == 0.0) return;
        for (int v = 0; v < w; ++v) front.at(row, v) -= entry * front.at(top, v) / t;
        front.constant(row) += entry * constant;
      };
      for (int i = 0; i < front.began; ++i) eliminate(front.began_row() + i);
      for (const int slot : stage.dying) eliminate(front.slot_row(slot));
      for (int v = 0; v < w; ++v) front.at(0, v) -= front.at(top, v) * push;
      front.drop_first_energy_row();
      front.variables = w;
    }
    front.compress();

    const int dying = static_cast<int>(stage.dying.size());
    records.push_back({record, front.began, dying, front.variables});
    for (int v = 0; v <= front.variables; ++v) {
      const double* const c = v < front.variables ? front.column(v) : front.constants();
      record = std::copy_n(c + front.began_row(), front.began, record);
      for (const int slot : stage.dying) *record++ = c[front.slot_row(slot)];
    }
  }
  substitute(before, after, 1.0, [&](int c, double value) { accelerations[c] = value; });
  return complete;
}

}  // namespace pipedyn
