"""Many units measured on one head: is an error the head's, shared by all of them, or each unit's own?"""

from tumblecal.diagnosis.head.together import Together as Together
from tumblecal.diagnosis.head.together import together as together
