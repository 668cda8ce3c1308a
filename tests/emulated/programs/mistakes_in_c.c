// The link in C of mistakes.cpp: it answers each chassis command, as the firmware echo does.
#include "enterprize_link.h"
#include "mistakes.h"

static enterprize_link_t* link_in_use;

static void on_chassis_cmd(void* context, const enterprize_chassis_cmd_t* command) {
  const enterprize_chassis_msg_t echo = {command->x_vel, command->y_vel, command->w_vel};
  (void)context;
  if (enterprize_send_chassis_msg(link_in_use, &echo) != WIREBOND_OK) { /* counted there, and nobody to tell */
  }
}

static const enterprize_link_handlers_t handlers = {.on_chassis_cmd = on_chassis_cmd};

bool c_link_open(const wirebond_port_t* port) {
  link_in_use = enterprize_link_open(&handlers, port);
  return link_in_use != NULL;
}
void c_link_poll(uint32_t now_us) { enterprize_link_poll(link_in_use, now_us); }
const char* c_link_why(void) { return wirebond_why_text(enterprize_link_why(link_in_use)); }

void c_link_on_received(void) { enterprize_link_on_received(link_in_use); }
void c_link_on_transmitted(void) { enterprize_link_on_transmitted(link_in_use); }
void c_link_on_pended(void) { enterprize_link_on_pended(link_in_use); }
