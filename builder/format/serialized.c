#include "serialized.h"
