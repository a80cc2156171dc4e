#include "vulkan_input.h"
