// Rows of payloads as columns of numbers, without an object for each message.
#include "wirebond/engine/columns.hpp"

namespace wirebond::engine {

namespace {

void add_columns(const std::vector<FieldTable>& fields, const std::string& prefix, std::size_t place, bool& moves,
                 bool may_lack, std::vector<Column>& out) {
  for (const FieldTable& field : fields) {
    if (is_flattened(field)) {
      const bool is_counted = field.repeat == Repeat::listed;
      moves = moves || is_counted;
      for (std::size_t i = 0; i < elements_of(field); ++i) {
        const std::string index = field.repeat == Repeat::once ? "" : "[" + std::to_string(i) + "]";
        add_columns(field.fields, prefix + field.name + index + ".", place + field.at + i * field.stride, moves,
                    may_lack || is_counted, out);
      }
      continue;
    }
    out.push_back({prefix + field.name, &field, place + field.at, moves, may_lack});
    moves = moves || field.is_variable;
  }
}

}  // namespace

std::vector<Column> columns_of(const MessageTable& message) {
  std::vector<Column> columns;
  bool moves = false;
  add_columns(message.fields, "", 0, moves, false, columns);
  return columns;
}

}  // namespace wirebond::engine
