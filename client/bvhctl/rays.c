#include "rays.h"
