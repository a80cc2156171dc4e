#include "vertex_format.h"
